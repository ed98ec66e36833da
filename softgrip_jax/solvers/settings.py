"""What solvers take as settings."""

from __future__ import annotations

import math
from typing import Any

from ..errors import InputError


def require_number(name: str, value: Any, below: float = math.inf, what: str = "a positive number") -> None:
    """An InputError where a setting, called `name`, is not a plain number above zero and below a bound."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < below:
        raise InputError(f"{name} is {value!r}; it must be {what}.")
