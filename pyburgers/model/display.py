"""How quantities are shown: display units, symbols, digits. Nothing here is read back."""

import math
from dataclasses import replace

from pyburgers.common.units import UNITS, number
from pyburgers.model.parameters import PARAMETER_BY_NAME, RATE_PARAMETERS, Parameter
from pyburgers.model.prior_families import Prior
from pyburgers.model.read_quantities import STRAIN, STRESS
from pyburgers.model.reference_quantities import REFERENCE_QUANTITIES

STRESS_UNIT, STRESS_FACTOR = STRESS.display_unit, STRESS.display_factor
STRAIN_UNIT, STRAIN_FACTOR = STRAIN.display_unit, STRAIN.display_factor
LENGTH_UNIT, LENGTH_FACTOR = "µm", 1.0 / UNITS["length"]["um"]
"""Units of curves and the factors from SI."""

_TIME_UNITS = tuple(UNITS["time"].items())
_LEAST_TIME_UNITS = 10

_GREEK = {
    r"\Delta ": "Δ",
    r"\Delta": "Δ",
    r"\delta": "δ",
    r"\alpha": "α",
    r"\tau": "τ",
    r"\eta": "η",
    r"\sigma": "σ",
    r"\beta": "β",
    r"\phi ": "φ",
    r"\phi": "φ",
    r"\dot\epsilon": "ε̇",
    r"\epsilon": "ε",
}
_UNIT_TEXT = {
    "1": "–",
    "um": "µm",
    "1e-6/s": "10⁻⁶/s",
    "1e-6/K": "10⁻⁶/K",
    "percent": "%",
    "cm3/mol": "cm³/mol",
}


def cycles_text(median_stress: float, amplitude: float) -> str:
    """Return the stress of cycles (Pa) in words, such as ``1 ± 0.17 MPa``."""
    return (
        f"{number(median_stress * STRESS_FACTOR)} ± {number(amplitude * STRESS_FACTOR)} "
        f"{STRESS_UNIT}"
    )


def time_unit(longest: float) -> tuple[str, float]:
    """Return the unit in which times up to one (s) are shown, and its seconds.

    It is the largest of which the longest time has at least ten.
    """
    fitting = [unit for unit in _TIME_UNITS if longest >= _LEAST_TIME_UNITS * unit[1]]
    return fitting[-1] if fitting else _TIME_UNITS[0]


def shown_quantity(name: str) -> Parameter:
    """Return symbol, label and units of a sampled quantity.

    Parameters
    ----------
    name : str
        A parameter, a point of the flow law such as the reference stress, or a quantity of tables
        of rates. Behind it, in brackets, may be what it belongs to, such as a mechanism.

    Raises
    ------
    KeyError
        If there is no such quantity.

    Examples
    --------
    >>> pyburgers.shown_quantity("maxwell_modulus").label
    'Maxwell modulus'
    """
    beside = {**REFERENCE_QUANTITIES, **{p.name: p for p in RATE_PARAMETERS}}
    base, _, owner = name.removesuffix("]").partition("[")
    known = beside.get(base) or PARAMETER_BY_NAME[base]
    if not owner:
        return known
    symbol, label = f"{known.symbol}[{owner}]", f"{known.label}, {owner}"
    return replace(known, name=name, symbol=symbol, label=label)


def label_of(name: str) -> str:
    """Return what a message calls something sampled, such as an error of what drives a test."""
    try:
        return shown_quantity(name).label
    except KeyError:
        return name.replace("_", " ")


def unit_text(quantity: Parameter) -> str:
    """Display unit as printed; an en dash where there is none.

    Examples
    --------
    >>> pyburgers.unit_text(pyburgers.shown_quantity("maxwell_modulus"))
    'GPa'
    """
    return _UNIT_TEXT.get(quantity.display_unit, quantity.display_unit)


def unit_after_number(quantity: Parameter) -> str:
    """Display unit behind a space; nothing where there is none, or a fraction."""
    return "" if quantity.display_unit in {"1", "fraction"} else f" {unit_text(quantity)}"


def axis_label(quantity: Parameter) -> str:
    """Symbol and unit for an axis, as matplotlib text."""
    return f"${quantity.symbol}$ ({unit_text(quantity)})"


def symbol_text(quantity: Parameter) -> str:
    """Symbol as plain text, what follows an underscore being its subscript.

    Examples
    --------
    >>> pyburgers.symbol_text(pyburgers.shown_quantity("maxwell_modulus"))
    'E_M'
    """
    text = quantity.symbol.replace("{", "").replace("}", "")
    for command, letter in _GREEK.items():
        text = text.replace(command, letter)
    return text


def prior_text(prior: Prior, quantity: Parameter | None = None, *, with_unit: bool = True) -> str:
    """Return a prior in the notation of statistics and display units, such as ``N(65, 2) kJ/mol``.

    U is uniform, N normal with its standard deviation, HN half-normal, LN lognormal with median
    and standard deviation of the logarithm. The quantity has to be given where it is no parameter
    of a curve. The unit may be left out where it stands beside the text.
    """
    quantity = quantity or PARAMETER_BY_NAME[prior.parameter]
    factor = quantity.display_factor
    location = number(prior.location * factor)
    lower, upper = number(prior.lower * factor), number(prior.upper * factor)
    unit = unit_after_number(quantity) if with_unit else ""
    match prior.family:
        case "fixed":
            return f"fixed: {location}{unit}"
        case "uniform":
            return f"U[{lower}, {upper}]{unit}"
        case "half_normal":
            # Often a share of the largest stress, whose digits mean nothing.
            return f"HN({prior.scale * factor:.3g}){unit}"
        case "lognormal":
            return f"LN({location}, {number(prior.scale)}){unit}"
        case "normal":
            bounds = (math.isfinite(prior.lower), math.isfinite(prior.upper))
            cut = {
                (False, False): "",
                (True, False): f", > {lower}",
                (False, True): f", < {upper}",
                (True, True): f", in [{lower}, {upper}]",
            }[bounds]
            # A prior taken from another fit has all the digits of a computed number.
            mean, sd = prior.location * factor, prior.scale * factor
            return f"N({mean:.4g}, {sd:.3g}){unit}{cut}"
