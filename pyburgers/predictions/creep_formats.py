"""Creep laws in the syntax of flow codes; docs/export.md has the conventions and their sources."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.predictions.creep_laws import MPA, YEAR, CreepLaw

Factors = Mapping[float, float]
"""A exp(-Q/(R T)) d^-p in MPa^-n a^-1 (`rate_factors`) by temperature (K)."""

UNIT_DENOMINATOR = 10**6
"""Largest denominator of the exponents of units, which are rational in Julia."""


@dataclass(frozen=True)
class CreepFormat:
    """How a code takes a creep law.

    `body` gives the lines of a law whose energy suits `gas_constant`.
    `by_temperature` says whether it takes factors at temperatures instead of an energy.
    `comment` begins a comment; empty if the lines are JSON, in which "NOTES" stands for the notes.
    """

    code: str
    body: Callable[[CreepLaw, str, Factors], list[str]]
    comment: str = "#"
    gas_constant: float = GAS_CONSTANT
    by_temperature: bool = False

    def text(self, law: CreepLaw, name: str, notes: Sequence[str], factors: Factors) -> str:
        """Return the file of a law of that name, with its notes as comments."""
        lines = [
            *notes,
            "Law: rate = A tau^n d^-p exp(-Q/(R T)), tau = sqrt(s:s/2), rate = sqrt(e:e/2).",
            "A is 3^((n+1)/2)/2 F^-n times that of axial compression, with the fabric factor "
            f"F = {law.fabric_factor!r}.",
            "No water, melt or pressure term: those of the specimens.",
            f"d = {law.grain_size!r} m, p = {law.grain_size_exponent!r}. A includes d^-p if no "
            "line below has a grain size.",
        ]
        if self.gas_constant != GAS_CONSTANT:
            lines.append(
                f"Q is {self.gas_constant}/{GAS_CONSTANT} times the fitted one, for R = "
                f"{self.gas_constant} J/(mol K) in {self.code}."
            )
        suited = law.with_gas_constant(self.gas_constant)
        body = self.body(suited, name, factors)
        if not self.comment:
            quoted = json.dumps(lines, ensure_ascii=False)
            return "\n".join(body).replace('"NOTES"', quoted) + "\n"
        return "\n".join([*(f"{self.comment} {line}" for line in lines), *body]) + "\n"


def _is_linear(law: CreepLaw) -> bool:
    return law.stress_exponent == 1


def _aspect(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return a block of the parameter file: diffusion creep where n = 1, else dislocation creep."""
    kind = "diffusion" if _is_linear(law) else "dislocation"
    law = law if _is_linear(law) else law.at_its_grain_size()
    entries = {
        "Viscous flow law": kind,
        f"Prefactors for {kind} creep": repr(law.prefactor),
        f"Stress exponents for {kind} creep": repr(law.stress_exponent),
        f"Activation energies for {kind} creep": repr(law.activation_energy),
        f"Activation volumes for {kind} creep": "0",
    }
    if _is_linear(law):
        entries[f"Grain size exponents for {kind} creep"] = repr(law.grain_size_exponent)
        entries["Grain size"] = repr(law.grain_size)
    return [
        "subsection Material model",
        "  subsection Visco Plastic",
        *(f"    set {key} = {value}" for key, value in entries.items()),
        "  end",
        "end",
    ]


def _underworld(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return a file for `ViscousCreepRegistry`; a "Burgers vector" of 1 m leaves d in metres."""
    per_stress = f"1 / pascal ** {law.stress_exponent!r} / second"
    coefficients = {
        "preExponentialFactor": (law.prefactor, per_stress),
        "stressExponent": (law.stress_exponent, "None"),
        "activationEnergy": (law.activation_energy, "joule / mole"),
        "activationVolume": (0.0, "meter ** 3 / mole"),
        "grainSize": (law.grain_size, "meter"),
        "grainSizeExponent": (law.grain_size_exponent, "None"),
        "BurgersVectorLength": (1.0, "meter"),
    }
    record = {
        "Mineral": name,
        "Type": "Viscous Diffusion Creep" if _is_linear(law) else "Viscous Dislocation Creep",
        "notes": "NOTES",
        "coefficients": {
            key: {"units": unit, "value": value} for key, (value, unit) in coefficients.items()
        },
    }
    text = json.dumps({f"{name}, pyburgers export": record}, indent=1, ensure_ascii=False)
    return text.splitlines()


def _geoparams(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return a record of GeoParams.jl, whose grain size exponent is negative."""
    has_grains = law.grain_size_exponent != 0
    stress, grains = (
        Fraction(one).limit_denominator(UNIT_DENOMINATOR)
        for one in (-law.stress_exponent, law.grain_size_exponent)
    )
    unit = f"Pa^({stress.numerator}//{stress.denominator})"
    unit += f" * m^({grains.numerator}//{grains.denominator})" if has_grains else ""
    fields = {
        "Name": json.dumps(name, ensure_ascii=False).replace("$", r"\$"),
        "n": f"{law.stress_exponent!r}NoUnits",
        **({"p": f"{-law.grain_size_exponent!r}NoUnits"} if has_grains else {}),
        "A": f"{law.prefactor!r}{unit} / s",
        "E": f"{law.activation_energy!r}J / mol",
        "V": "0.0m^3 / mol",
        "R": f"{GAS_CONSTANT!r}J / mol / K",
        "Apparatus": "Invariant",
    }
    return [
        "using GeoParams",
        f"grain_size = {law.grain_size!r}m  # for d = grain_size where a function takes it",
        f"creep_law = {'GrainBoundarySliding' if has_grains else 'DislocationCreep'}(;",
        *(f"    {key} = {value}," for key, value in fields.items()),
        ")",
    ]


def _lamem(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return the material of an input file."""
    law = law.at_its_grain_size()
    letter = "d" if _is_linear(law) else "n"
    return [
        "<MaterialStart>",
        "    ID = 0",
        f"    B{letter} = {law.prefactor!r}",
        *([] if _is_linear(law) else [f"    n = {law.stress_exponent!r}"]),
        f"    E{letter} = {law.activation_energy!r}",
        f"    V{letter} = 0",
        "<MaterialEnd>",
    ]


def _pism(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return a file for -options_file; the law "arr" has one Arrhenius branch and no pressure."""
    law = law.at_its_grain_size()
    options = [
        (f"stress_balance.{part}.{key}", value)
        for part in ("sia", "ssa")
        for key, value in (
            ("flow_law", "arr"),
            ("Glen_exponent", repr(law.stress_exponent)),
            ("enhancement_factor", "1"),
        )
    ]
    options += [
        ("flow_law.Paterson_Budd.A_cold", repr(law.prefactor)),
        ("flow_law.Paterson_Budd.Q_cold", repr(law.activation_energy)),
    ]
    return [f"-{key} {value}" for key, value in options]


def _elmer(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return lines of a material in MPa, m and a; temperatures there are in degrees Celsius."""
    law = law.at_its_grain_size()
    factor = law.prefactor * MPA**law.stress_exponent * YEAR
    return [
        "! Units: MPa, m, a (365.25 d). Both branches of the temperature are the same.",
        '  Viscosity Model = String "Glen"',
        f"  Glen Exponent = Real {law.stress_exponent!r}",
        "  Glen Enhancement Factor = Real 1.0",
        "  Limit Temperature = Real -10.0",
        *(
            f"  {key} {branch} = Real {value!r}"
            for key, value in (
                ("Rate Factor", factor),
                ("Activation Energy", law.activation_energy),
            )
            for branch in (1, 2)
        ),
    ]


def _icepack(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return a table of A and n at temperatures, in MPa and a."""
    return [
        "# fluidity in MPa^-n a^-1 (a = 365.25 d); n replaces icepack.constants.glen_flow_law",
        "temperature_K,n,fluidity",
        *(
            f"{temperature!r},{law.stress_exponent!r},{factor!r}"
            for temperature, factor in factors.items()
        ),
    ]


CREEP_FORMATS = {
    "aspect": CreepFormat("ASPECT", _aspect, gas_constant=8.3144621),
    "elmer": CreepFormat("Elmer/Ice", _elmer, "!", gas_constant=8.314),
    "geoparams": CreepFormat("GeoParams.jl", _geoparams),
    "icepack": CreepFormat("icepack", _icepack, by_temperature=True),
    "lamem": CreepFormat("LaMEM", _lamem, gas_constant=8.3144621),
    "pism": CreepFormat("PISM", _pism, gas_constant=8.31441),
    "underworld": CreepFormat("UWGeodynamics", _underworld, "", gas_constant=8.3144621),
}
"""Creep laws by the name of the format."""
