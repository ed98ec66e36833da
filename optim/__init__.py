"""Design by gradient: variables of scenes, what is wanted of their solutions, and the search for it; and calibration.

What the package offers is listed in `__init__.pyi` and imported on first use, so that its commands can be listed at
once.

>>> import optim
>>> run = optim.load_run("runs/shell_grasp-001")
"""

import lazy_loader

import softgrip_jax as _softgrip_jax  # noqa: F401  it switches JAX to float64

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
