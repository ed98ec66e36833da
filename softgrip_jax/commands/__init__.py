"""The commands, one file each: what it reads, does and writes. Their options are declared in `softgrip_jax.cli`."""
