"""What names of columns say against what is stated beside them, in files and in Python."""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.units import FORCE_UNITS
from pyburgers.kinds.column_names import (
    ALONG_AXIS,
    COLUMN_NAMES,
    ENGINEERING,
    SHEAR,
    plain,
    unit_in_name,
)

TENSION = r"elong|tensile|(?<![a-z])zug(?!eh)"
"""Pattern of columns of stress or strain that are positive in tension."""


OF_SHEAR = (
    "write sqrt(3) tau as the stress, gamma/sqrt(3) as the strain, 3 G as a modulus of relaxation"
)
"""What an axial test with the same second invariants reads."""


@dataclass(frozen=True)
class OtherForm:
    """Another form of quantities, told by a pattern of names: what it is, and what turns it."""

    of: Collection[str]
    pattern: str
    what: str
    remedy: str


OTHER_FORMS = (
    OtherForm(
        ALONG_AXIS,
        r"torque|torsion|drehmoment|(?<![a-z])couple(?![a-z])|twist|verdreh|verdrill",
        "torsion",
        "a torque M gives tau = (3 + 1/n) M/(2 pi R^3) at the outer radius R, a twist theta of the "
        f"length L gives gamma = R theta/L; {OF_SHEAR}",
    ),
    OtherForm(
        ALONG_AXIS,
        "octahedral",
        "octahedral values",
        "write 3/sqrt(2) times the stress, and sqrt(2) times the strain (a tensor component)",
    ),
    OtherForm(ALONG_AXIS, SHEAR, "shear", OF_SHEAR),
    OtherForm(
        {"stress"},
        rf"(?:load|force|kraft|charge).*(?<![a-z])(?:n|{FORCE_UNITS})(?![a-z/])"
        rf"|[(\[](?:n|{FORCE_UNITS})[)\]](?! ?/)|pounds?.?force",
        "a force",
        "divide it by the area of the sample",
    ),
    OtherForm(
        {"strain"},
        r"(?:strain|eps|exten|displac|shorten|lvdt|stauch|verkurz|weg(?![a-z])|raccourc|allong).*"
        r"(?<![a-z/])(?:mm|cm|[uμ]m|microns?|inch(?:es)?|in)(?![a-z/])",
        "a change of length",
        "divide it by the length of the sample",
    ),
    OtherForm(
        {"attenuation"},
        "^(?!.*/ ?(?:pi|π)).*de[ck]rement",
        "a logarithmic decrement",
        "divide it by pi",
    ),
    OtherForm(
        {"attenuation"},
        r"^(?!.*2 ?(?:pi|π)).*(?:(?:δ|delta|d) ?_?([ewu]) ?/ ?\1(?![a-z])|damp\w*.?[ck]apa)",
        "the energy lost in a cycle over the energy stored",
        "divide it by 2 pi",
    ),
    OtherForm(
        {"attenuation"},
        r"(?<![a-z])sin[ _(]*(?:delta|δ|phi|φ)",
        "a sine of the loss angle",
        "write tan(arcsin(...)) of it",
    ),
    OtherForm(
        {"attenuation"},
        r"fwhm|(?:half|peak|band|line).?width|halbwert"
        r"|^(?!.*(?:tan|phase|angle)).*(?:δ|delta) ?_?f(?![a-z])",
        "the width of a resonance",
        "divide it by the frequency, and by sqrt(3) if it is that at half of the amplitude",
    ),
    OtherForm(
        {"attenuation"},
        r"^q$|^(?!.*(?:inv|recip|1 ?/|-1)).*(?:quality|gutefaktor)",
        "a quality factor",
        "write 1/Q",
    ),
)
"""Shear and torsion as axial tests with the same second invariants; definitions of attenuation."""


DEFAULT_UNITS = {"temperature": "K", "stress": "MPa"}
"""Units of columns whose unit need not be stated, but in tables of rates."""


def unit_stated(of: str, kind: str, keys: Mapping[str, Any], *, has_default: bool) -> Any:
    """Return the unit that keys state for a quantity, or for several of its kind."""
    shared = "modulus_unit" if "modulus" in of else f"{kind}_unit"
    default = DEFAULT_UNITS.get(kind) if has_default else None
    return keys.get(f"{of}_unit", keys.get(shared, default))


def contradicted_unit(column: str | int, name: str, kind: str, unit: object) -> Iterator[str]:
    """Say where the plain name of a column says another unit than is stated."""
    if kind == "attenuation" and other_form(name, kind):  # which is told in its place
        return
    named = unit_in_name(name, kind)
    if named is not None and named != str(unit).removeprefix("deg" * (named == "C")):
        said = f"unit {unit!r} is stated" if unit else "no unit is stated"
        other = f"the unit {named!r}" if named else "another unit, a factor, or a logarithm"
        yield f"{said} for column {column!r}, whose name says {other}: check it."


def other_form(name: str, quantity: str) -> OtherForm | None:
    """Return the other form of a quantity that the plain name of a column says, if any."""
    return next(
        (one for one in OTHER_FORMS if quantity in one.of and re.search(one.pattern, name)), None
    )


def contradicted_form(column: str | int, name: str, quantity: str) -> Iterator[str]:
    """Say where the plain name of a column says another form of a quantity than files have."""
    form = other_form(name, quantity)
    if form is not None:
        along = " along the axis" if quantity in ALONG_AXIS else ""
        yield (
            f"column {column!r} is read as the {quantity.replace('_', ' ')}{along}, but its name "
            f"is that of {form.what}: {form.remedy}."
        )


def contradicted_measure(
    column: str | int,
    name: str,
    quantity: str,
    keys: Mapping[str, Any],
    numbers: FloatArray,
    *,
    is_history: bool,
) -> Iterator[str]:
    """Say where the plain name of a column of a deformation test says another measure or sign."""
    if quantity not in ("stress", "strain"):
        return
    if re.search(ENGINEERING, name) and keys.get(f"{quantity}_measure") != "engineering":
        turns = "turn it, or let a loading history turn it"
        if is_history:
            turns = f'write {quantity}_measure = "engineering"'
        yield (
            f"column {column!r} is taken as true {quantity}, though its name says engineering: "
            f"{turns}."
        )
    is_turned = keys.get("compression") == "negative"
    if is_history and re.search(TENSION, name) and not is_turned and np.nanmedian(numbers) > 0:
        yield (
            f"column {column!r} is read with compression positive, but its name is that of "
            'tension: write compression = "negative".'
        )


def contradicted_units(called: str, arguments: Mapping[str, Any]) -> Iterator[str]:
    """Say where names of columns of pandas among arguments contradict what is said beside them."""
    for key, values in arguments.items():
        of = key.removeprefix("stress_").removesuffix("_uncertainty")
        name, dtype = getattr(values, "name", None), getattr(values, "dtype", None)
        # Time stamps and texts have no unit of their own to be named.
        if name is None or of not in COLUMN_NAMES or getattr(dtype, "kind", "") not in "iuf":
            continue
        kind = COLUMN_NAMES[of].kind
        unit = unit_stated(of, kind, arguments, has_default=True)
        yield from contradicted_unit(name, plain(str(name)), kind, unit)
        yield from contradicted_form(name, plain(str(name)), of)
        if called != "ForcedOscillation":
            history = called != "ConstantRateTest"
            yield from contradicted_measure(
                name, plain(str(name)), of, arguments, values, is_history=history
            )
