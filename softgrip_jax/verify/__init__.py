"""Finite elements of a scene, beside our models: what `softgrip verify` does."""
