"""The parameters of the nonlinear Burgers model: names, symbols, units, order.

The order of `PROGRAM_PARAMETERS` is the order of the parameter vector in the Stan programs
(`stan/physics/parameters.stan`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from pyburgers.common.units import UNITS
from pyburgers.model.laws import NONLINEAR_KELVIN_PARAMETERS


@dataclass(frozen=True)
class Parameter:
    """One parameter of the model.

    `name`: name in files, draws and tables.
    `symbol`: the paper's symbol as matplotlib mathtext, without dollar signs.
    `label`: plain words for tables and axes.
    `quantity`: physical quantity, a key of `pyburgers.common.units.UNITS`.
    `display_unit`: unit of figures and tables.
    `standard`: SI value of a parameter of a variant where nothing is said about it: the value that
        leaves it without effect. None for parameters that always have to be given.
    """

    name: str
    symbol: str
    label: str
    quantity: str = "dimensionless"
    display_unit: str = "1"
    standard: float | None = None

    @property
    def si_unit(self) -> str:
        """Unit of stored values."""
        return next(unit for unit, factor in UNITS[self.quantity].items() if factor == 1.0)

    @property
    def display_factor(self) -> float:
        """Factor from SI to `display_unit`."""
        return 1.0 / UNITS[self.quantity][self.display_unit]


_ONE, _ENTHALPY = "dimensionless", "activation enthalpy"
_OF_RECOVERY = "activation enthalpy of static recovery"

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("maxwell_modulus", r"E_M", "Maxwell modulus", "stress", "GPa"),
    Parameter("kelvin_modulus", r"E_K", "Kelvin modulus", "stress", "GPa"),
    Parameter("kelvin_viscosity", r"\eta_K", "Kelvin viscosity", "viscosity", "GPa s"),
    Parameter("stress_exponent", r"n", "stress exponent"),
    Parameter("grain_size_exponent", r"p", "grain size exponent"),
    Parameter("activation_enthalpy", r"Q_M", "activation enthalpy", "molar energy", "kJ/mol"),
    Parameter("beta", r"\beta", "pre-exponent ln(A)/Q", "inverse molar energy", "mol/kJ"),
    Parameter("steady_state_grain_size", r"d_{ss}", "steady-state grain size", "length", "um"),
    Parameter("steady_state_fabric_factor", r"F_{ss}", "steady-state fabric factor"),
    Parameter(
        "critical_strain_grain_size",
        r"\epsilon_{c1}",
        "critical strain of grain size",
        "strain",
        "fraction",
    ),
    Parameter(
        "critical_strain_fabric",
        r"\epsilon_{c2}",
        "critical strain of fabric",
        "strain",
        "fraction",
    ),
    Parameter("stress_noise", r"s", "stress residual", "stress", "MPa"),
)
"""Every parameter that a prior file has to name, in the order of the Stan programs."""

VARIANT_PARAMETERS: tuple[Parameter, ...] = (
    Parameter("kelvin_stress_exponent", r"n_K", "Kelvin stress exponent", standard=1.0),
    Parameter(
        "kelvin_activation_enthalpy",
        r"Q_K",
        "Kelvin activation enthalpy",
        "molar energy",
        "kJ/mol",
        standard=0.0,
    ),
    Parameter(
        "kelvin_reference_stress",
        r"q_0",
        "driving stress of the Kelvin viscosity",
        "stress",
        "MPa",
        standard=1e6,
    ),
    Parameter(
        "kelvin_reference_temperature",
        r"T_0",
        "temperature of the Kelvin viscosity and of the recovery rate",
        "temperature",
        "K",
        standard=273.15,
    ),
    Parameter(
        "residual_correlation_strain",
        r"\epsilon_r",
        "correlation strain of residuals",
        "strain",
        "fraction",
        standard=0.0,
    ),
    Parameter(
        "piezometer_reference_grain_size",
        r"d_1",
        "grain size of the piezometer at 1 MPa",
        "length",
        "mm",
        standard=0.0,
    ),
    Parameter("piezometer_exponent", r"m", "stress exponent of the piezometer", standard=1.0),
    Parameter(
        "piezometer_stress_floor",
        r"\sigma_f",
        "least stress of the piezometer",
        "stress",
        "MPa",
        standard=1e6,
    ),
    Parameter(
        "breakdown_stress",
        r"\sigma_L",
        "stress at which power-law creep breaks down",
        "stress",
        "MPa",
        standard=0.0,
    ),
    Parameter("residual_correlated_share", r"w", "share of residuals that correlate", standard=1.0),
    Parameter(
        "modulus_temperature_coefficient",
        r"a_E",
        "relative change of the Maxwell modulus with temperature",
        "inverse temperature",
        "1e-6/K",
        standard=0.0,
    ),
    Parameter(
        "modulus_reference_temperature",
        r"T_E",
        "temperature of the Maxwell modulus",
        "temperature",
        "K",
        standard=300.0,
    ),
    Parameter("attenuation_scatter", r"s_Q", "scatter of ln tan delta", standard=0.0),
    Parameter("modulus_scatter", r"s_G", "scatter of ln modulus", standard=0.0),
    Parameter("strain_noise", r"s_\epsilon", "strain residual", "strain", "percent", standard=1.0),
    Parameter(
        "residual_correlation_time",
        r"\tau_r",
        "correlation time of residuals",
        "time",
        "h",
        standard=0.0,
    ),
    Parameter(
        "strain_offset",
        r"\epsilon_0",
        "strain read at zero strain",
        "strain",
        "percent",
        standard=0.0,
    ),
    Parameter(
        "apparatus_compliance",
        r"C",
        "compliance of the apparatus",
        "compliance",
        "1/GPa",
        standard=0.0,
    ),
    Parameter(
        "relaxation_time_decades",
        r"\delta_\tau",
        "width of the band of relaxation times in decades",
        standard=0.0,
    ),
    Parameter(
        "relaxation_exponent", r"\alpha", "exponent of the band of relaxation times", standard=0.5
    ),
    Parameter("peak_strength", r"\Delta_P", "relaxation strength of the peak", standard=0.0),
    Parameter(
        "peak_time_decades",
        r"\delta_P",
        "decades from the peak to the longest relaxation time",
        standard=0.0,
    ),
    Parameter("peak_width", r"\sigma_P", "width of the peak in ln(relaxation time)", standard=0.0),
    Parameter("andrade_exponent", r"a", "exponent of Andrade creep", standard=0.0),
    Parameter(
        "kelvin_grain_size_exponent",
        r"m_K",
        "grain size exponent of relaxation times",
        standard=0.0,
    ),
    Parameter(
        "kelvin_reference_grain_size",
        r"d_K",
        "grain size of the Kelvin viscosity",
        "length",
        "um",
        standard=1e-5,
    ),
    Parameter(
        "threshold_stress",
        r"\sigma_t",
        "stress up to which the dashpot does not flow",
        "stress",
        "MPa",
        standard=0.0,
    ),
    *(
        Parameter(name, symbol, label, quantity, unit, standard)
        for name, symbol, label, quantity, unit, standard in (
            ("hardening_modulus", "H", "hardening modulus of the backstress", "stress", "GPa", 0.0),
            ("backstress_limit", r"\sigma_{max}", "limit of the backstress", "stress", "MPa", 1e6),
            ("recovery_rate", "r", "rate of static recovery", "strain rate", "1e-6/s", 0.0),
            ("recovery_exponent", "m_r", "exponent of static recovery", _ONE, "1", 1.0),
            ("recovery_activation_enthalpy", "Q_r", _OF_RECOVERY, "molar energy", "kJ/mol", 0.0),
            ("initial_backstress", r"\sigma_{b0}", "backstress at the start", "stress", "MPa", 0.0),
            ("source_stress", r"\sigma_d", "stress of dislocation sources", "stress", "MPa", 0.0),
            ("boundary_recovery", "c_r", "recovery by grain boundaries", _ONE, "1", 0.0),
            ("reference_backstress", r"\sigma_0", "reference backstress", "stress", "MPa", 0.0),
        )
    ),
    Parameter(
        "discrepancy", r"\delta", "discrepancy of the law over the reading error", standard=0.0
    ),
    *(
        Parameter(
            f"{which}_{name}", symbol, f"{label} of the {which} mechanism", quantity, unit, standard
        )
        for which, place in (("second", "2"), ("third", "3"))
        for name, symbol, label, quantity, unit, standard in (
            ("rate", f"r_{place}", "rate", "strain rate", "1e-6/s", 0.0),
            ("stress_exponent", f"n_{place}", "stress exponent", _ONE, "1", 1.0),
            ("grain_size_exponent", f"p_{place}", "grain size exponent", _ONE, "1", 0.0),
            ("activation_enthalpy", f"Q_{place}", _ENTHALPY, "molar energy", "kJ/mol", 0.0),
            ("in_series", f"s_{place}", "arrangement", _ONE, "1", 0.0),
        )
    ),
    *(
        Parameter(
            f"mechanism_reference_{name}", symbol, f"{label} of mechanism rates", quantity, unit, si
        )
        for name, symbol, label, quantity, unit, si in (
            ("stress", "S_r", "stress", "stress", "MPa", 1e6),
            ("grain_size", "d_r", "grain size", "length", "um", 1e-3),
            ("temperature", "T_r", "temperature", "temperature", "K", 273.15),
        )
    ),
    *(
        Parameter(f"{whose}{name}", symbol + place, label + of, quantity, unit, standard=0.0)
        for whose, place, of in (
            ("", "}", ""),
            ("second_", "2}", " of the second mechanism"),
            ("third_", "3}", " of the third mechanism"),
            ("kelvin_", "K}", " of the Kelvin part"),
            ("recovery_", "r}", " of static recovery"),
        )
        for name, symbol, label, quantity, unit in (
            ("activation_volume", "V_{M", "activation volume", "molar volume", "cm3/mol"),
            ("water_exponent", "r_{f", "exponent of the water fugacity", _ONE, "1"),
            ("melt_factor", r"\alpha_{\phi", "change of ln(rate) by melt", _ONE, "1"),
        )
    ),
)
"""Parameters of variants (`docs/variants.md`), which a prior file may name."""

CONDITION_PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "temperature_error",
        r"\Delta T",
        "true less stated temperature",
        "temperature",
        "K",
        standard=0.0,
    ),
    Parameter(
        "stress_calibration_error",
        r"c",
        "relative error of the load cell",
        "relative error",
        "percent",
        standard=0.0,
    ),
)
"""Errors of the conditions of a test; their priors come from its file, not from the material's."""

ENVIRONMENT_PARAMETERS: tuple[Parameter, ...] = (
    Parameter("pressure", r"P", "pressure", "stress", "MPa", standard=0.0),
    Parameter("water_fugacity", r"f", "water fugacity", "stress", "MPa", standard=1e6),
    Parameter("melt_fraction", r"\phi", "melt fraction", standard=0.0),
)
"""What surrounds or fills the sample of a test, which its file states."""

ENVIRONMENT = tuple(p.name for p in ENVIRONMENT_PARAMETERS)
"""Its names, those of `pyburgers.kinds.experiment.Experiment.environment`."""

ENVIRONMENT_NUMBERS = ("activation_volume", "water_exponent", "melt_factor")
"""What a rate makes of each of `ENVIRONMENT`; below, all rates of the material."""
ALL_ENVIRONMENT_NUMBERS = tuple(
    f"{whose}{name}"
    for whose in ("", "second_", "third_", "kelvin_", "recovery_")
    for name in ENVIRONMENT_NUMBERS
)

RESIDUAL_CORRELATION = (
    "residual_correlation_strain",
    "residual_correlation_time",
    "residual_correlated_share",
    "discrepancy",
)
"""Parameters of how residuals hang together."""

STANDARD_VALUES: Mapping[str, float] = MappingProxyType(
    {
        p.name: p.standard
        for p in (*VARIANT_PARAMETERS, *CONDITION_PARAMETERS, *ENVIRONMENT_PARAMETERS)
        if p.standard is not None
    }
)
"""SI values of the parameters of variants and conditions where nothing is said about them."""

MATERIAL_PARAMETERS: tuple[Parameter, ...] = (*PARAMETERS, *VARIANT_PARAMETERS)
"""What a prior file may name."""

PROGRAM_PARAMETERS: tuple[Parameter, ...] = (
    *MATERIAL_PARAMETERS,
    *CONDITION_PARAMETERS,
    *ENVIRONMENT_PARAMETERS,
)

PLACE: Mapping[str, int] = {p.name: k for k, p in enumerate(PROGRAM_PARAMETERS, start=1)}
"""Place of each parameter in the programs, as in `stan/physics/parameters.stan`."""
"""The parameter vector of the Stan programs for curves."""

PIEZOMETER = (
    "piezometer_reference_grain_size",
    "piezometer_exponent",
    "piezometer_stress_floor",
)
"""What the piezometer of a material is given by; without a grain size it has none."""

CONDITIONS = frozenset(p.name for p in CONDITION_PARAMETERS)
"""Errors of the conditions of a test, by name."""

KELVIN_REFERENCES: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(NONLINEAR_KELVIN_PARAMETERS, "kelvin_reference_stress"),
        "kelvin_activation_enthalpy": "kelvin_reference_temperature",
        "kelvin_grain_size_exponent": "kelvin_reference_grain_size",
    }
)
"""Where the Kelvin viscosity varies by the first, the second says for what it is given."""

MECHANISM_REFERENCES = (
    "mechanism_reference_stress",
    "mechanism_reference_grain_size",
    "mechanism_reference_temperature",
)
"""Conditions for which the rates of further mechanisms are given."""

_OF_MECHANISM = (
    "rate",
    "stress_exponent",
    "grain_size_exponent",
    "activation_enthalpy",
    "in_series",
)

FURTHER_MECHANISMS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {which: tuple(f"{which}_{name}" for name in _OF_MECHANISM) for which in ("second", "third")}
)
"""Parameters of each further mechanism of the dashpot; without the first there is none.

The last is 1 where the second is in series with the first, or the third with the second.
"""

STRESS_EXPONENTS = ("stress_exponent", *(own[1] for own in FURTHER_MECHANISMS.values()))
"""Of all mechanisms of the dashpot."""

FURTHER_PARAMETERS = (
    *(name for own in FURTHER_MECHANISMS.values() for name in own),
    *MECHANISM_REFERENCES,
)
"""All that further mechanisms of the dashpot are given by."""

CONSTANTS = frozenset(
    {
        *KELVIN_REFERENCES.values(),
        "modulus_reference_temperature",
        "reference_backstress",
        *PIEZOMETER,
        *MECHANISM_REFERENCES,
        *(own[-1] for own in FURTHER_MECHANISMS.values()),
        *ENVIRONMENT,
    }
)
"""Parameters that are never inferred."""

GIVEN_TOGETHER: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        **{name: (reference,) for name, reference in KELVIN_REFERENCES.items()},
        PIEZOMETER[0]: PIEZOMETER[1:],
        "relaxation_time_decades": ("relaxation_exponent",),
        "peak_strength": ("peak_time_decades", "peak_width"),
        "hardening_modulus": ("backstress_limit",),
        "recovery_exponent": (),
        "reference_backstress": (
            "initial_backstress",
            "source_stress",
            "boundary_recovery",
            "kelvin_reference_grain_size",
        ),
        "recovery_activation_enthalpy": ("kelvin_reference_temperature",),
        **{own[0]: (*own[1:-1], *MECHANISM_REFERENCES) for own in FURTHER_MECHANISMS.values()},
        **dict.fromkeys(STRESS_EXPONENTS[1:], ()),
    }
)
"""Where the first is not left without effect, the others have to be given too."""

BELOW_ONE = frozenset({"relaxation_exponent", "andrade_exponent"})
"""Exponents of relaxation and creep, which at 1 are a dashpot."""

PARAMETER_BY_NAME: Mapping[str, Parameter] = MappingProxyType(
    {p.name: p for p in PROGRAM_PARAMETERS}
)
