"""Laws of the dashpot and of the Kelvin part: a record for each.

Priors, choices, export, advice and tables of combinations follow from the records. The equations
are in `stan/physics/dashpot_laws.stan`, `stan/physics/kelvin_element.stan` and
`stan/physics/relaxation.stan`, the parameters in `pyburgers.model.parameters`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Law:
    """A law of one part of the model.

    `parameters` are those that it frees. `expression` is the law in an export; `{slower}` stands
    for a factor of the Kelvin viscosity. `own_stress` says whether it has a stress of its own,
    `closed_form` whether stress cycles have a closed form, `one_time` whether there is at most one
    relaxation time.
    """

    name: str
    parameters: tuple[str, ...]
    expression: str
    own_stress: bool = False
    closed_form: bool = True
    one_time: bool = True


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
            f"strain_rate = ({self.expression})^stress_exponent * grain_size^-grain_size_exponent"
            " * exp(ln_flow_law_factor - activation_enthalpy/(R*temperature))"
        )


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
_BAND_PARAMETERS = ("relaxation_time_decades", "relaxation_exponent")


def _creep(name: str, parameters: tuple[str, ...], creep: str) -> Law:
    """Return a linear law by its Kelvin strain over the stress that was put on a time ago."""
    return Law(name, parameters, f"kelvin_strain/stress = {creep}", one_time=False)


KELVIN_LAWS: Mapping[str, Law] = MappingProxyType(
    {
        law.name: law
        for law in (
            Law("linear", (), _RATE.format(nonlinear="")),
            Law(
                "power_law",
                ("kelvin_stress_exponent",),
                _RATE.format(
                    nonlinear=f"*abs({_DRIVING}/kelvin_reference_stress)"
                    "^(kelvin_stress_exponent - 1)"
                ),
                own_stress=True,
                closed_form=False,
            ),
            _creep("two_elements", ("peak_strength", "peak_time_decades"), _ELEMENT + _SECOND),
            _creep("extended", _BAND_PARAMETERS, _BAND),
            _creep(
                "extended_peak",
                (*_BAND_PARAMETERS, "peak_strength", "peak_time_decades", "peak_width"),
                _BAND + _PEAK,
            ),
            _creep(
                "andrade",
                ("andrade_exponent",),
                f"(time/({_TIME}))^andrade_exponent/kelvin_modulus",
            ),
        )
    }
)
"""Laws of the Kelvin part by name; modulus and viscosity are parameters of all."""

DASHPOT_LAWS: Mapping[str, DashpotLaw] = MappingProxyType(
    {
        law.name: law
        for law in (
            DashpotLaw("power_law", (), "stress/fabric_factor", neighbours=("hyperbolic_sine",)),
            DashpotLaw("linear", (), "stress/fabric_factor"),
            DashpotLaw(
                "hyperbolic_sine",
                ("breakdown_stress",),
                "breakdown_stress*sinh(stress/(fabric_factor*breakdown_stress))",
                own_stress=True,
                words="Flow law that is proportional to small stresses and exponential in large "
                "ones.",
            ),
            DashpotLaw(
                "threshold_stress",
                ("threshold_stress",),
                "max(stress - threshold_stress, 0)/fabric_factor",
                own_stress=True,
                closed_form=False,
                stress_share=0.1,
                words="Stress up to which a dashpot does not flow.",
            ),
        )
    }
)
"""Laws of the dashpot by name. A stress of its own is 0 in every other law."""

DASHPOT_STRESSES: Mapping[str, DashpotLaw] = MappingProxyType(
    {law.parameters[0]: law for law in DASHPOT_LAWS.values() if law.own_stress}
)
"""Laws of the dashpot by their own stress."""


def laws_in_closed_form() -> Mapping[str, tuple[str, ...]]:
    """Return the laws of each part under which stress cycles have a closed form."""
    parts: Mapping[str, Mapping[str, Law]] = {"kelvin": KELVIN_LAWS, "maxwell": DASHPOT_LAWS}
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
