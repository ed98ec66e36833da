"""Calibration: numbers of scenes from measured curves, how sure they are, and what the data cannot tell."""
