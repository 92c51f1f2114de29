"""Fits of curves and of tables, told apart by their run directories."""

from pathlib import Path

from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import PeakStressFit, is_peak_stress_run
from pyburgers.flow_law_tables.rate_fit import RateFit, is_rate_run


def fit_of_run(path: str | Path) -> Fit | PeakStressFit | RateFit:
    """Read a run directory of any kind; raise InputError if it is none."""
    if is_rate_run(path):
        return RateFit.load(path)
    return PeakStressFit.load(path) if is_peak_stress_run(path) else Fit.load(path)
