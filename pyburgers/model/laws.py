"""Laws of the dashpot, its hardening, its further mechanisms and the Kelvin part: records.

Priors, choices, export, advice and tables of combinations follow from the records. The equations
are in `stan/physics/dashpot_laws.stan`, `stan/physics/hardening.stan`,
`stan/physics/dashpot_mechanisms.stan`, `stan/physics/kelvin_laws.stan` and
`stan/physics/relaxation.stan`, the parameters in `pyburgers.model.parameters`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True)
class Law:
    """A law of one part of the model.

    `parameters` are those that it frees. `expression` is the law in an export; `{slower}` stands
    for a factor of the Kelvin viscosity. `own_stress` says whether it has a stress of its own,
    `closed_form` whether stress cycles have a closed form. `redefines` are quantities of other laws
    that mean something else in this one.
    """

    name: str
    parameters: tuple[str, ...]
    expression: str
    own_stress: bool = False
    closed_form: bool = True
    redefines: tuple[str, ...] = ()


@dataclass(frozen=True)
class DashpotLaw(Law):
    """A law of the dashpot: a power law of the stress in `expression`.

    `neighbours` are laws that data may hardly tell from it. The prior median of its own stress is
    `stress_share` of the largest measured stress. `words` say what it is.
    """

    neighbours: tuple[str, ...] = ("power_law",)
    stress_share: float = 1.0
    words: str = ""

    @property
    def flow_law(self) -> str:
        """The whole law in an export."""
        return (
            f"strain_rate = sign(stress) * ({self.expression})^stress_exponent"
            " * grain_size^-grain_size_exponent"
            " * exp(ln_flow_law_factor - activation_enthalpy/(R*temperature))"
        )


@dataclass(frozen=True)
class RelaxationTimes:
    """Relaxation times that a law of the Kelvin part has, and the sum of elements for them.

    They are there if the parameter `switch` is not left at its standard value. `spread` says how
    elements are chosen: "one" is one time beside the longest one; "band" lies between two ends
    that the parameter `width` (decades) sets apart; "peak" is log-normal with the standard
    deviation `width`; "endless" has no ends. A band and endless times take the place of the
    longest time, the others stand beside it.
    """

    switch: str
    spread: Literal["one", "band", "peak", "endless"] = "one"
    width: str = ""


@dataclass(frozen=True)
class KelvinLaw(Law):
    """A law of the Kelvin part.

    `times` are its relaxation times, if there are several. Priors have the law if exactly its
    `switches` are not left at their standard values, and `without` are. `weak_priors` replace the
    numbers of the weak priors of freed parameters. `conventions` are fixed at their prior means,
    because data fix them only together with others.
    """

    times: tuple[RelaxationTimes, ...] = ()
    without: tuple[str, ...] = ()
    weak_priors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    conventions: tuple[str, ...] = ()

    @property
    def switches(self) -> tuple[str, ...]:
        """Parameters that tell the law from the linear one."""
        return self.parameters if self.own_stress else tuple(one.switch for one in self.times)


_DRIVING = "(stress - kelvin_modulus*kelvin_strain)"
_RATE = f"kelvin_strain_rate = {_DRIVING}{{nonlinear}}/(kelvin_viscosity{{{{slower}}}})"
_TIME = "kelvin_viscosity/kelvin_modulus{slower}"
_ELEMENT = f"(1 - exp(-time/({_TIME})))/kelvin_modulus"
_BAND = (
    f"integral(10^(-relaxation_exponent*u)*(1 - exp(-time/(({_TIME})*10^-u))), u, 0,"
    " relaxation_time_decades)*relaxation_exponent*log(10)"
    "/(1 - 10^(-relaxation_exponent*relaxation_time_decades))/kelvin_modulus"
)
_PEAK = (
    " + peak_strength/maxwell_modulus*integral(exp(-x^2/2)/sqrt(2*pi)"
    f"*(1 - exp(-time/(({_TIME})*10^-peak_time_decades*exp(peak_width*x)))), x, -8, 8)"
)
_SECOND = f" + peak_strength/maxwell_modulus*(1 - exp(-time/(({_TIME})*10^-peak_time_decades)))"
_CREEP = "kelvin_strain/stress = "
_BAND_PARAMETERS = ("relaxation_time_decades", "relaxation_exponent")
_LONGEST_TIME = ("kelvin_viscosity",)
_ONE_ELEMENT = ("kelvin_modulus", "kelvin_viscosity")


_STRENGTH = "peak_strength"
_BAND_TIMES = RelaxationTimes(_BAND_PARAMETERS[0], "band", width=_BAND_PARAMETERS[0])
_PEAK_TIMES = RelaxationTimes(_STRENGTH, "peak", width="peak_width")

KELVIN_LAWS: Mapping[str, KelvinLaw] = {
    law.name: law
    for law in (
        KelvinLaw("linear", (), _RATE.format(nonlinear="")),
        # The viscosity is that at the driving stress `kelvin_reference_stress`.
        KelvinLaw(
            "power_law",
            ("kelvin_stress_exponent",),
            _RATE.format(
                nonlinear=f"*abs({_DRIVING}/kelvin_reference_stress)^(kelvin_stress_exponent - 1)"
            ),
            own_stress=True,
            closed_form=False,
            redefines=_LONGEST_TIME,
        ),
        KelvinLaw(
            "two_elements",
            (_STRENGTH, "peak_time_decades"),
            f"{_CREEP}{_ELEMENT}{_SECOND}",
            times=(_PEAK_TIMES,),
            without=("peak_width",),
            redefines=_ONE_ELEMENT,
            weak_priors={
                _STRENGTH: {
                    "location": 0.3,
                    "scale": 1.5,
                    "source": "Not in the paper: a second element of a thirtieth of the "
                    "elastic compliance up to thrice it",
                }
            },
        ),
        KelvinLaw(
            "extended",
            _BAND_PARAMETERS,
            f"{_CREEP}{_BAND}",
            times=(_BAND_TIMES,),
            redefines=_LONGEST_TIME,
        ),
        KelvinLaw(
            "extended_peak",
            (*_BAND_PARAMETERS, _STRENGTH, "peak_time_decades", "peak_width"),
            f"{_CREEP}{_BAND}{_PEAK}",
            times=(_BAND_TIMES, _PEAK_TIMES),
            redefines=_ONE_ELEMENT,
        ),
        KelvinLaw(
            "andrade",
            ("andrade_exponent",),
            f"{_CREEP}(time/({_TIME}))^andrade_exponent/kelvin_modulus",
            times=(RelaxationTimes("andrade_exponent", "endless"),),
            conventions=("kelvin_modulus",),
            redefines=_ONE_ELEMENT,
        ),
    )
}
"""Laws of the Kelvin part by name; modulus and viscosity are parameters of all."""

KELVIN_SWITCHES: tuple[str, ...] = tuple(
    dict.fromkeys(name for law in KELVIN_LAWS.values() for name in law.switches)
)
"""Parameters whose standard value takes a law of the Kelvin part out."""

NONLINEAR_KELVIN_PARAMETERS: tuple[str, ...] = tuple(
    law.parameters[0] for law in KELVIN_LAWS.values() if law.own_stress
)
"""Parameters of the laws of one Kelvin element beside the linear one: one each."""

RELAXATION_TIMES: tuple[RelaxationTimes, ...] = tuple(
    dict.fromkeys(one for law in KELVIN_LAWS.values() for one in law.times)
)
"""Relaxation times of all laws with several of them."""

SPECTRUM_SWITCHES: tuple[str, ...] = tuple(one.switch for one in RELAXATION_TIMES)
"""Parameters whose standard value takes a law with several relaxation times out."""

SPECTRUM_PARAMETERS: tuple[str, ...] = tuple(
    dict.fromkeys(name for law in KELVIN_LAWS.values() if law.times for name in law.parameters)
)
"""Parameters of the laws with several relaxation times."""

# Where another stress drives the power law, or the rate has another factor, n and A are not those
# of the stress.
_FLOW_LAW = ("reference_stress", "reference_flow_rate", "stress_exponent", "beta")

DASHPOT_LAWS: Mapping[str, DashpotLaw] = {
    law.name: law
    for law in (
        DashpotLaw("power_law", (), "abs(stress)/fabric_factor", neighbours=("hyperbolic_sine",)),
        DashpotLaw("linear", (), "abs(stress)/fabric_factor"),
        DashpotLaw(
            "hyperbolic_sine",
            ("breakdown_stress",),
            "breakdown_stress*sinh(abs(stress)/(fabric_factor*breakdown_stress))",
            own_stress=True,
            redefines=_FLOW_LAW,
            words="Flow law that is proportional to small stresses and exponential in large ones.",
        ),
        DashpotLaw(
            "threshold_stress",
            ("threshold_stress",),
            "max(abs(stress) - threshold_stress, 0)/fabric_factor",
            own_stress=True,
            closed_form=False,
            redefines=_FLOW_LAW,
            stress_share=0.1,
            words="Stress up to which a dashpot does not flow.",
        ),
    )
}
"""Laws of the dashpot by name. A stress of its own is 0 in every other law."""

DASHPOT_STRESSES: Mapping[str, DashpotLaw] = {
    law.parameters[0]: law for law in DASHPOT_LAWS.values() if law.own_stress
}
"""Laws of the dashpot by their own stress."""


@dataclass(frozen=True)
class HardeningLaw(Law):
    """A law of the hardening of the dashpot.

    `driving` is the stress of the flow law in an export, `density` a factor of its rate.
    """

    driving: str = "stress"
    density: str = ""


_RECOVERING = (
    "^(recovery_exponent - 1){boundaries})*exp(-recovery_activation_enthalpy/R"
    "*(1/temperature - 1/kelvin_reference_temperature))"
)
_SOURCES = "source_stress*kelvin_reference_grain_size/grain_size"

HARDENING_LAWS: Mapping[str, HardeningLaw] = {
    law.name: law
    for law in (
        HardeningLaw("none", (), ""),
        HardeningLaw(
            "backstress",
            (
                "hardening_modulus",
                "backstress_limit",
                "recovery_rate",
                "recovery_exponent",
            ),
            "backstress_rate = hardening_modulus*(strain_rate"
            " - abs(strain_rate)*backstress/backstress_limit)"
            " - recovery_rate*(backstress*abs(backstress/backstress_limit)"
            + _RECOVERING.format(boundaries=""),
            redefines=_FLOW_LAW,
            driving="(stress - backstress)",
        ),
        HardeningLaw(
            "dislocations",
            (
                "hardening_modulus",
                "backstress_limit",
                "recovery_rate",
                "initial_backstress",
                "source_stress",
                "boundary_recovery",
            ),
            "backstress_rate = hardening_modulus*(strain_rate"
            f"*(1 + {_SOURCES}/backstress) - abs(strain_rate)*backstress/backstress_limit)"
            " - recovery_rate*(backstress*(backstress/reference_backstress)"
            + _RECOVERING.format(
                boundaries=f" + boundary_recovery*{_SOURCES}*(backstress/reference_backstress)^3"
            ),
            redefines=(*_FLOW_LAW, "recovery_rate"),
            driving=f"(stress - backstress - {_SOURCES})",
            density="*(backstress/reference_backstress)^2",
        ),
    )
}
"""Laws of the hardening of the dashpot by name; the first parameter is 0 without any."""

HARDENING_SWITCH = "hardening_modulus"
"""Parameter that takes the backstress out at 0."""

DISLOCATIONS_SWITCH = "reference_backstress"
"""Parameter that is 0 where the backstress is not that of dislocations."""


@dataclass(frozen=True)
class Mechanism(Law):
    """A further mechanism of the dashpot.

    `expression` is a rate with it, of the rate `own` and of the one `before`. `in_series` says
    whether the second is in series with the first, or the third with the second. Its numbers have
    the values `held` (SI) where priors do not say them.
    """

    in_series: bool = False
    held: Mapping[str, float] = field(default_factory=dict)


def _mechanism(
    which: str, name: str, exponent: float, grain_size_exponent: float, *, in_series: bool = False
) -> Mechanism:
    return Mechanism(
        name,
        (f"{which}_rate",),
        "1/(1/({before}) + 1/({own}))" if in_series else "{before} + {own}",
        closed_form=not in_series,
        in_series=in_series,
        held={
            f"{which}_stress_exponent": exponent,
            f"{which}_grain_size_exponent": grain_size_exponent,
        },
    )


MECHANISMS: Mapping[str, Mapping[str, Mechanism]] = {
    which: {
        law.name: law
        for law in (
            Mechanism("none", (), "{before}"),
            # Along grain boundaries (Coble 1963, Journal of Applied Physics 34, 1679-1682).
            _mechanism(which, "diffusion", 1.0, 3.0),
            # Sliding along grain boundaries, and basal slip, of ice (Goldsby and Kohlstedt
            # 2001, Journal of Geophysical Research 106, 11017-11030, Table 5).
            _mechanism(which, "power_law", 1.8, 1.4),
            _mechanism(which, "in_series", 2.4, 0.0, in_series=True),
        )
    }
    for which in ("second", "third")
}
"""Laws of the second and of the third mechanism of the dashpot by name."""


def rate_of_mechanisms(second: str, third: str) -> str:
    """Return the rate of the dashpot in an export, from those of its mechanisms."""
    of_third, of_second = MECHANISMS["third"][third], MECHANISMS["second"][second]
    own = "second_mechanism"
    if of_third.in_series:
        own = of_third.expression.format(before=own, own="third_mechanism")
    rate = of_second.expression.format(before="first_mechanism", own=own)
    if of_third.in_series:
        return rate
    return of_third.expression.format(before=rate, own="third_mechanism")


def further_rate(which: str) -> str:
    """Return the rate of a further mechanism in an export."""
    return (
        f"{which}_rate*sign(stress)*(abs(stress)/mechanism_reference_stress)^{which}_stress_exponent"
        f"*(grain_size/mechanism_reference_grain_size)^-{which}_grain_size_exponent"
        f"*exp(-{which}_activation_enthalpy/R"
        "*(1/temperature - 1/mechanism_reference_temperature))"
    )


def laws_in_closed_form() -> Mapping[str, tuple[str, ...]]:
    """Return the laws of each part under which stress cycles have a closed form."""
    parts: Mapping[str, Mapping[str, Law]] = {
        "kelvin": KELVIN_LAWS,
        "maxwell": DASHPOT_LAWS,
        **{f"{which}_mechanism": laws for which, laws in MECHANISMS.items()},
    }
    return {
        part: tuple(law.name for law in laws.values() if law.closed_form)
        for part, laws in parts.items()
    }


def laws_to_try_first() -> Mapping[str, str]:
    """Return options of laws with a stress of their own that are next to the standard ones.

    Keys are the parameters that are free in them.
    """
    neighbours = [DASHPOT_LAWS[name] for name in DASHPOT_LAWS["power_law"].neighbours]
    parts: Mapping[str, list[Law]] = {"kelvin": [*KELVIN_LAWS.values()], "maxwell": [*neighbours]}
    return {
        law.parameters[0]: f"{part}={law.name}"
        for part, laws in parts.items()
        for law in laws
        if law.own_stress
    }
