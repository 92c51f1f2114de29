"""Linear laws of the Kelvin part, of many draws: compliance at frequencies, creep, spectrum.

As in ``stan/physics/relaxation.stan``, with which tests compare it; here the integrals over
relaxation times are sums of Kelvin elements, which answer in frequency and in time.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gamma

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.model.arrhenius import log_slowdown
from pyburgers.model.kelvin_elements import band_elements, peak_elements
from pyburgers.model.laws import (
    NONLINEAR_KELVIN_PARAMETERS,
    SPECTRUM_PARAMETERS,
    SPECTRUM_SWITCHES,
)
from pyburgers.model.parameters import KELVIN_REFERENCES, STANDARD_VALUES

ERROR = 1e-8
"""Of the sums, relative to the relaxed compliance."""

RELAXATION_PARAMETERS = (
    *SPECTRUM_PARAMETERS,
    *KELVIN_REFERENCES,
    *KELVIN_REFERENCES.values(),
)
"""What laws of the Kelvin part have beside modulus and viscosity."""


@dataclass(frozen=True, eq=False)
class KelvinPart:
    """The Kelvin part at one temperature and grain size.

    `longest_time`: tau = eta_K/E_K there, s, with the shape of the draws.
    `values`: moduli and the parameters of its law (SI) by name, with the shape of the draws.
    """

    longest_time: FloatArray
    values: Mapping[str, FloatArray]

    @property
    def is_one_element(self) -> bool:
        """Whether it has one relaxation time in every draw."""
        return not any(self.values[name].any() for name in SPECTRUM_SWITCHES)

    @property
    def _is_andrade(self) -> bool:
        return bool(self.values["andrade_exponent"].any())

    def elements(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield relaxation time (s) and compliance (1/Pa) of its elements, shape of the draws each.

        Andrade creep has none.
        """
        values, compliance = self.values, 1 / self.values["kelvin_modulus"]
        width = np.log(10) * values["relaxation_time_decades"]
        if width.any():
            exponent = values["relaxation_exponent"]
            scale = compliance * exponent * width / -np.expm1(-exponent * width)
            for place, weight in zip(*band_elements(float(width.max()), ERROR), strict=True):
                below = (1 - place) * width
                yield self.longest_time * np.exp(-below), weight * scale * np.exp(-exponent * below)
        else:
            yield self.longest_time, compliance
        strength = values["peak_strength"]
        if strength.any():
            middle = self.longest_time * 10 ** -values["peak_time_decades"]
            spread = values["peak_width"]
            for place, share in zip(*peak_elements(float(spread.max()), ERROR), strict=True):
                yield middle * np.exp(spread * place), share * strength / values["maxwell_modulus"]

    def compliance(self, angular_frequency: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return storage and loss compliance (1/Pa) at angular frequencies (rad/s).

        Frequencies are broadcast against draws with one dimension more at the end.
        """
        if self._is_andrade:
            exponent = self.values["andrade_exponent"][..., np.newaxis]
            size = (angular_frequency * self.longest_time[..., np.newaxis]) ** -exponent
            size = size * gamma(1 + exponent) / self.values["kelvin_modulus"][..., np.newaxis]
            angle = 0.5 * np.pi * exponent
            return size * np.cos(angle), size * np.sin(angle)
        storage, loss = np.zeros(()), np.zeros(())
        for time, compliance in self.elements():
            delay = angular_frequency * time[..., np.newaxis]
            share = compliance[..., np.newaxis] / (1 + delay**2)
            storage, loss = storage + share, loss + share * delay
        return storage, loss

    def spectrum(self, log_time: FloatArray) -> FloatArray:
        """Return the density of the compliance over ln of the relaxation time, 1/Pa.

        It has the shape of the draws and then (n,), that of `log_time`, ln(time / s). Elements of
        one time, which have no density, are left out.
        """
        values = {name: own[..., np.newaxis] for name, own in self.values.items()}
        compliance = 1 / values["kelvin_modulus"]
        below = np.log(self.longest_time)[..., np.newaxis] - log_time
        if self._is_andrade:
            exponent = values["andrade_exponent"]
            return np.asarray(
                compliance * exponent / gamma(1 - exponent) * np.exp(-exponent * below)
            )
        width = np.log(10) * values["relaxation_time_decades"]
        density = np.zeros(below.shape)
        if width.any():
            exponent = values["relaxation_exponent"]
            scale = compliance * exponent / -np.expm1(-exponent * width)
            density += np.where(
                (below >= 0) & (below <= width), scale * np.exp(-exponent * below), 0.0
            )
        spread = values["peak_width"]
        if values["peak_strength"].any() and spread.any():
            away = (below - np.log(10) * values["peak_time_decades"]) / spread
            strength = values["peak_strength"] / values["maxwell_modulus"]
            density += strength / (spread * np.sqrt(2 * np.pi)) * np.exp(-0.5 * away**2)
        return density

    def creep(self, time: float) -> FloatArray:
        """Return the strain over the stress that was put on a time (s) ago, shape of the draws."""
        if self._is_andrade:
            return np.asarray(
                (time / self.longest_time) ** self.values["andrade_exponent"]
                / self.values["kelvin_modulus"]
            )
        strain = np.zeros(())
        with np.errstate(divide="ignore"):  # without viscosity it follows at once
            for relaxation, compliance in self.elements():
                strain = strain - compliance * np.expm1(-time / relaxation)
        return strain


def kelvin_part(
    parameters: Mapping[str, npt.ArrayLike], temperature: float, grain_size: FloatArray
) -> KelvinPart:
    """Return the Kelvin part of draws at a temperature (K) and grain size (m, shape of the draws).

    `parameters` are moduli and viscosity (SI), and `RELAXATION_PARAMETERS` where they have an
    effect. Raise InputError if the dashpot is a power law, which has no compliance.
    """
    shape = grain_size.shape
    values = {
        name: np.broadcast_to(
            np.asarray(parameters.get(name, STANDARD_VALUES.get(name)), dtype=np.float64), shape
        )
        for name in (
            "maxwell_modulus",
            "kelvin_modulus",
            "kelvin_viscosity",
            *RELAXATION_PARAMETERS,
        )
    }
    for name in NONLINEAR_KELVIN_PARAMETERS:
        if (values[name] != STANDARD_VALUES[name]).any():
            raise InputError(
                f"{name}: found values other than {STANDARD_VALUES[name]:g}, expected a linear "
                "Kelvin part because the spectrum in closed form needs it; simulate cycles of any "
                "other as a loading history."
            )
    slower = log_slowdown(
        values["kelvin_activation_enthalpy"], temperature, values["kelvin_reference_temperature"]
    )
    coarser = grain_size / values["kelvin_reference_grain_size"]
    time = values["kelvin_viscosity"] / values["kelvin_modulus"] * np.exp(slower)
    return KelvinPart(time * coarser ** values["kelvin_grain_size_exponent"], values)


def require_one_relaxation_time(parameters: Mapping[str, npt.ArrayLike]) -> None:
    """Refuse laws that are not solved in time under imposed stress.

    Raise InputError if the Kelvin part has many relaxation times, or one that depends on grain
    size.
    """
    for name in (*SPECTRUM_SWITCHES, "kelvin_grain_size_exponent"):
        if np.any(np.asarray(parameters.get(name, 0.0)) != 0):
            raise InputError(
                f"{name}: found values other than 0, expected a Kelvin part of one relaxation time "
                "because a solution in time needs it; the closed form takes any."
            )
