"""Creep laws and compliances in shear as other codes take them; docs/export.md has the sources."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import pandas as pd

from pyburgers.common.array_types import FloatArray
from pyburgers.common.csv_tables import comment_lines, csv_text, in_one_line
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.kinds.attenuation.table import Elasticity
from pyburgers.kinds.conditions import Ranges
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.predictions.attenuation import DEFAULT_FREQUENCIES, material_spectrum
from pyburgers.predictions.material import (
    elastic_modulus_sentence,
    frozen_limit_texts,
    frozen_sentence,
)
from pyburgers.predictions.stated_laws import MPA, YEAR, CreepLaw, Stated, stated_material
from pyburgers.predictions.stress_cycles import Regime

Factors = Mapping[float, float]
"""A exp(-Q/(R T)) d^-p in MPa^-n a^-1 (`rate_factors`) by temperature (K)."""


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
            "p = 0: the grain size has no effect."
            if law.grain_size_exponent == 0
            else f"d = {law.grain_size!r} m, p = {law.grain_size_exponent!r}. A includes d^-p if "
            "no line below has a grain size.",
        ]
        if self.gas_constant != GAS_CONSTANT:
            lines.append(
                f"Q is {self.gas_constant}/{GAS_CONSTANT} times the fitted one, for R = "
                f"{self.gas_constant} J/(mol K) in {self.code}."
            )
        energy = law.activation_energy * (self.gas_constant / GAS_CONSTANT)
        body = self.body(replace(law, activation_energy=energy), name, factors)
        if not self.comment:
            quoted = json.dumps(lines, ensure_ascii=False)
            return "\n".join(body).replace('"NOTES"', quoted) + "\n"
        return "\n".join([*(f"{self.comment} {in_one_line(one)}" for one in lines), *body]) + "\n"


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
        Fraction(one).limit_denominator(10**6)  # exponents of units are rational in Julia
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
        *(
            [f"grain_size = {law.grain_size!r}m  # for d = grain_size where a function takes it"]
            if has_grains
            else []
        ),
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
    lines = []
    for part in ("sia", "ssa"):
        lines += [
            f"-stress_balance.{part}.flow_law arr",
            f"-stress_balance.{part}.Glen_exponent {law.stress_exponent!r}",
            f"-stress_balance.{part}.enhancement_factor 1",
        ]
    return [
        *lines,
        f"-flow_law.Paterson_Budd.A_cold {law.prefactor!r}",
        f"-flow_law.Paterson_Budd.Q_cold {law.activation_energy!r}",
    ]


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
        f"  Rate Factor 1 = Real {factor!r}",
        f"  Rate Factor 2 = Real {factor!r}",
        f"  Activation Energy 1 = Real {law.activation_energy!r}",
        f"  Activation Energy 2 = Real {law.activation_energy!r}",
    ]


def _icepack(law: CreepLaw, name: str, factors: Factors) -> list[str]:
    """Return a table of A and n at temperatures, in MPa and a."""
    return [
        "# fluidity in MPa^-n a^-1 (a = 365.25 d); n replaces icepack.constants.glen_flow_law",
        "temperature_K,n,fluidity",
        *(f"{at!r},{law.stress_exponent!r},{factor!r}" for at, factor in factors.items()),
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


@dataclass(frozen=True, eq=False)
class ShearCompliances:
    """Storage and loss of all draws in shear (n_draws, n), 1/Pa, at frequencies (n,), Hz.

    `rates`: those of the dashpot under the regime, of which there may be none.
    """

    frequency: FloatArray
    storage: FloatArray
    loss: FloatArray
    rates: Ranges
    notes: tuple[str, ...]


OTHER_RATIO = (
    "The fitted table states another Poisson's ratio or a bulk modulus, so that shear moduli here "
    "are not those that were read."
)
"""Note of compliances that another elasticity converts than that of the table."""


@dataclass(frozen=True)
class ComplianceFormat:
    """How a code takes compliances: `columns` of a CSV table by frequency, J1 and J2."""

    code: str
    columns: Callable[[FloatArray, FloatArray, FloatArray], dict[str, FloatArray]]

    def text(
        self, frequency: FloatArray, storage: FloatArray, loss: FloatArray, notes: Sequence[str]
    ) -> str:
        """Return the table of one draw or of the mean, with notes as comments above it."""
        table = pd.DataFrame(self.columns(frequency, storage, loss))
        return comment_lines(notes) + csv_text(table)


def shear_compliances(fit: SampledFit, stated: Stated, code: str) -> ShearCompliances:
    """Return the compliances in shear under a stated regime of axial stress."""
    if not isinstance(fit, Fit):
        raise InputError(f"{code}: found a fit of a table, expected one of tests with elements.")
    if stated.poisson_ratio is None:
        raise InputError(
            f"{code}: found no Poisson's ratio, expected --poisson-ratio: E_M is Young's modulus."
        )
    regime = stated.regime
    further = {fit.variant.second_mechanism, fit.variant.third_mechanism}
    linear = fit.variant.maxwell == "linear" and further <= {"none", "diffusion"}
    if regime is None and not linear:
        raise InputError(
            f"{code}: found no stress, expected --median-stress-MPa and --amplitude-MPa: "
            "the compliance of this dashpot depends on the stress."
        )
    frequency = stated.frequencies or DEFAULT_FREQUENCIES
    material = stated_material(fit, stated, code)
    # No stress changes the fluidity of a linear dashpot.
    spectrum = material_spectrum(material, frequency, [regime or Regime(0.0, 1.0)])
    storage, loss, elastic = (
        all_draws(spectrum[name])
        for name in ("storage_compliance", "loss_compliance", "elastic_compliance")
    )
    read = fit.experiment.poisson_ratio_in_shear
    of_spring, less, of_creep = Elasticity("shear", stated.poisson_ratio).conversion
    spring = elastic[:, np.newaxis]
    notes = [
        f"{spectrum.attrs['title']}, Poisson's ratio {stated.poisson_ratio:g}",
        "Shear: 1/G = 2 (1 + nu)/E_M; the compliance of creep is 3 times the axial one.",
        "Sign: exp(+i omega t), J* = J1 - i J2, G* = 1/J* = G1 + i G2; losses are positive.",
        *([OTHER_RATIO] if read not in (None, stated.poisson_ratio) else []),
        *([f"Axial stress {regime.label}; in shear over sqrt(3)."] if regime else []),
        f"{frozen_sentence(spectrum)} In the draws: {frozen_limit_texts(spectrum)[0]}.",
        elastic_modulus_sentence(spectrum),
    ]
    return ShearCompliances(
        frequency=np.asarray(frequency, dtype=np.float64),
        storage=of_spring * spring - less + of_creep * (storage[:, 0] - spring),
        loss=of_creep * loss[:, 0],
        rates={} if regime is None else material.dashpot_rates([regime]),
        notes=tuple(notes),
    )


def _tidal(frequency: FloatArray, storage: FloatArray, loss: FloatArray) -> dict[str, FloatArray]:
    modulus = 1 / (storage - 1j * loss)
    return {
        "frequency_Hz": frequency,
        "J1_per_Pa": storage,
        "J2_per_Pa": loss,
        "G1_Pa": modulus.real,
        "G2_Pa": modulus.imag,
    }


def _seismic(frequency: FloatArray, storage: FloatArray, loss: FloatArray) -> dict[str, FloatArray]:
    return {
        "frequency_Hz": frequency,
        "Q_mu": storage / loss,
        "shear_modulus_Pa": (1 / (storage - 1j * loss)).real,
    }


COMPLIANCE_FORMATS = {
    "specfem": ComplianceFormat("SPECFEM", _seismic),
    "tidalpy": ComplianceFormat("TidalPy", _tidal),
}
"""Compliances by the name of the format."""
