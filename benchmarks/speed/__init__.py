"""Speed against error: `python -m benchmarks.speed` makes docs/speed-and-error.md, its pictures and its tables."""
