"""Simulation-based calibration: data from the prior, their fits, the ranks of the truth."""
