"""Priors of one parameter that are stated in Python, as tables of a prior file."""

from collections.abc import Mapping
from pathlib import Path

from pyburgers.common.toml_files import checked
from pyburgers.model.prior_families import Family, PriorTable

STATED = "stated in Python"
"""Source of a prior that names no other."""


def normal(
    mean: float,
    sd: float,
    unit: str,
    *,
    lower: float | None = None,
    upper: float | None = None,
    source: str = STATED,
) -> PriorTable:
    """Return a normal prior, cut at bounds if there are any.

    Parameters
    ----------
    mean, sd : float
        Mean and standard deviation ahead of the cuts.
    unit : str
        Unit of all numbers, such as ``"kJ/mol"``.
    lower, upper : float, optional
        Bounds.
    source : str
        Origin of the prior, for tables and pages.

    Examples
    --------
    >>> law = pyburgers.normal(4, 0.5, "1", lower=1)
    >>> ice = pyburgers.priors("ice").with_(stress_exponent=law)
    """
    numbers = {"location": mean, "scale": sd, "lower": lower, "upper": upper}
    return _stated("normal", unit, source, numbers)


def lognormal(median: float, log_sd: float, unit: str, *, source: str = STATED) -> PriorTable:
    """Return a prior whose logarithm is normal.

    Parameters
    ----------
    median : float
        Median in `unit`.
    log_sd : float
        Standard deviation of the natural logarithm.
    unit, source
        As for `pyburgers.normal`.

    Examples
    --------
    >>> ice = pyburgers.priors("ice").with_(kelvin_modulus=pyburgers.lognormal(1, 0.5, "GPa"))
    """
    return _stated("lognormal", unit, source, {"location": median, "scale": log_sd})


def half_normal(sd: float, unit: str, *, source: str = STATED) -> PriorTable:
    """Return a normal prior about zero that is cut at zero.

    Parameters
    ----------
    sd : float
        Standard deviation of the whole normal.
    unit, source
        As for `pyburgers.normal`.

    Examples
    --------
    >>> ice = pyburgers.priors("ice").with_(stress_noise=pyburgers.half_normal(0.1, "MPa"))
    """
    return _stated("half_normal", unit, source, {"scale": sd})


def uniform(lower: float, upper: float, unit: str, *, source: str = STATED) -> PriorTable:
    """Return a prior that is the same between two bounds.

    Parameters
    ----------
    lower, upper : float
        Bounds.
    unit, source
        As for `pyburgers.normal`.

    Examples
    --------
    >>> ice = pyburgers.priors("ice").with_(stress_exponent=pyburgers.uniform(2, 6, "1"))
    """
    return _stated("uniform", unit, source, {"lower": lower, "upper": upper})


def fixed(value: float, unit: str, *, source: str = STATED) -> PriorTable:
    """Return a fixed value: the parameter is not inferred.

    Parameters
    ----------
    value : float
        The value.
    unit, source
        As for `pyburgers.normal`.

    Examples
    --------
    >>> ice = pyburgers.priors("ice").with_(stress_exponent=pyburgers.fixed(4, "1"))
    >>> ice["stress_exponent"].is_fixed
    True
    """
    return _stated("fixed", unit, source, {"value": value})


def _stated(
    family: Family, unit: str, source: str, numbers: Mapping[str, float | None]
) -> PriorTable:
    """Check the numbers of a prior that is stated in Python, as a table of a file is checked."""
    table = {"family": family, "unit": unit, "source": source, **numbers}
    return checked(Path(family), table, PriorTable)
