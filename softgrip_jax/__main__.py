"""`python -m softgrip_jax` is the command `softgrip`."""

from .cli import main

main()
