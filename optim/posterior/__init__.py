"""Posteriors of calibrated parameters by NUTS, what they predict, and evidence between models."""
