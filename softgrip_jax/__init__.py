"""softgrip_jax: differentiable models of pneumatic soft grippers, and design by gradient.

Importing this package switches JAX to float64 (``jax_enable_x64``), the one global setting that it changes.
"""

import jax

jax.config.update("jax_enable_x64", True)

from . import materials as materials  # noqa: E402
from . import objects as objects  # noqa: E402
from . import shell as shell  # noqa: E402
from . import units as units  # noqa: E402
from .materials import Gent as Gent  # noqa: E402
from .materials import MooneyRivlin as MooneyRivlin  # noqa: E402
from .materials import NeoHookean as NeoHookean  # noqa: E402
from .materials import Ogden as Ogden  # noqa: E402
from .materials import Yeoh as Yeoh  # noqa: E402
from .results import Solution as Solution  # noqa: E402
from .results import Status as Status  # noqa: E402
from .scene import Scene as Scene  # noqa: E402
from .scene import branch as branch  # noqa: E402
from .scene import limit_pressure as limit_pressure  # noqa: E402
from .scene import path as path  # noqa: E402
from .scene import pressure_for as pressure_for  # noqa: E402
from .scene import solve as solve  # noqa: E402
from .shell.flat_shell import FlatShell as FlatShell  # noqa: E402

__version__ = "0.1.0"
