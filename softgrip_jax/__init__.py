"""softgrip_jax: differentiable models of pneumatic soft grippers, and design by gradient.

Importing this package switches JAX to float64, the one global setting that it changes: through JAX's own switch where
JAX is already imported, otherwise through the environment variable JAX_ENABLE_X64, which JAX reads when it is.

What the package offers is listed in `__init__.pyi` and imported on first use, so that `softgrip --help` answers at
once.
"""

import os
import sys

import lazy_loader

from ._version import __version__ as __version__

if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)
else:
    os.environ["JAX_ENABLE_X64"] = "1"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
