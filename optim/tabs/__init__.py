"""Tabs of the explorer: what `softgrip design` and `softgrip calibrate` do, in the browser."""
