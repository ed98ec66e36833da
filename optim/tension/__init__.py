"""Tension tests: which material describes one, and where it would go wrong beyond it."""
