"""A run as one page: what was asked, what came out, plots, statuses with reasons, provenance, how to repeat it."""
