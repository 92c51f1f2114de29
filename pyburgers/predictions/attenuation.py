"""Attenuation of a pre-stressed nonlinear Burgers material: the exact spectrum, of many draws.

A constant median stress with a sinusoid on top, sigma_m + sigma_0 sin(omega t), drives the
material; its microstructure is frozen. Since stress is imposed, the elements of the series circuit
answer independently, and the strain at the frequency of the cycles is known in closed form for
any power law and any amplitude::

    J1 = 1/E_M + E_K/(E_K^2 + omega^2 eta_K^2)
    J2 = omega eta_K/(E_K^2 + omega^2 eta_K^2) + B/omega
    tan(delta) = J2/J1
    B  = 1/(pi sigma_0) * integral over 0..2 pi of g(sigma_m + sigma_0 sin x) sin(x) dx
    g(sigma) = sgn(sigma) (|sigma|/F)^n d^-p exp[Q_M (beta - 1/(R T))]

(of a hyperbolic sine with sigma_L sinh[|sigma|/(F sigma_L)] in place of |sigma|/F).

The dashpot's fluidity B depends on the regime of stresses but not on frequency. Higher harmonics
of the strain and its steady drift do not enter: tan(delta) is that of the fundamental.

The flow law g stands here although the physics is otherwise in ``stan/physics/`` alone: a whole
posterior times frequencies times regimes is one array expression this way. Tests compare it with
the Stan function ``dashpot_strain_rate`` and the spectrum with simulations in time
(`pyburgers.predictions.imposed_stress`).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.common.atomic_files import write_atomically
from pyburgers.common.errors import InputError
from pyburgers.common.units import UNITS, number
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT, STRESS_UNIT
from pyburgers.model.flow_law_prior import GAS_CONSTANT
from pyburgers.model.parameters import KELVIN_REFERENCES, STANDARD_VALUES
from pyburgers.predictions.stress_cycles import (
    BREAKDOWN,
    DRAW_DIMENSIONS,
    PAPER_REGIMES,
    PARAMETER_NAMES,
    Regime,
    checked_frequencies,
    checked_inputs,
)
from pyburgers.protocols.protocol import FittedTest

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Microstructure = Literal["initial", "steady_state"]

QUANTILES = (5, 25, 50, 75, 95)
"""Percentages of `quantile_table`."""

DEFAULT_FREQUENCIES: tuple[float, ...] = tuple(np.geomspace(1e-4, 1.0, 60).tolist())
"""Frequencies (Hz) of the paper's Fig. 6."""

OVERVIEW_FREQUENCIES = 5
"""Columns of `overview_table`."""

_NODES = 64
_NODES_SIGN_CHANGE = 1024
"""Nodes in half a period of stress. B is good to 1e-10 for stress exponents from 2.5; where stress
changes sign, g has a kink in a higher derivative and the sum converges less fast."""


def attenuation_spectrum(
    parameters: Mapping[str, npt.ArrayLike],
    frequencies: Sequence[float] | FloatArray = DEFAULT_FREQUENCIES,
    regimes: Sequence[Regime] = PAPER_REGIMES,
    *,
    temperature: float,
    grain_size: npt.ArrayLike,
    fabric_factor: npt.ArrayLike = 1.0,
) -> xr.Dataset:
    """Attenuation of every draw in every regime at every frequency (see the module's head).

    Parameters
    ----------
    parameters : mapping of str to array
        Draws of `PARAMETER_NAMES` (SI), all of one shape: ``()``, ``(draw,)`` or
        ``(chain, draw)``; other names are ignored, save those of a Kelvin element that is not
        linear, which are refused.
    frequencies : array, shape (n_frequencies,)
        Hz, positive.
    regimes : sequence of Regime
        Imposed stresses.
    temperature : float
        K.
    grain_size : float or array of the shape of the draws
        m.
    fabric_factor : float or array of the shape of the draws
        1 = isotropic.

    Returns
    -------
    Dataset
        ``tan_delta``, ``storage_compliance`` J1 and ``loss_compliance`` J2 (1/Pa), dimensions of
        the draws, then regime, frequency; ``debye_peak`` (see `has_debye_peak`) without
        frequency; ``grain_size`` and ``fabric_factor`` as used. Coordinates ``frequency`` (Hz),
        ``regime`` (label), ``median_stress`` and ``amplitude`` (Pa).

    Raises
    ------
    InputError
        If a parameter is missing, shapes differ, the Kelvin element is not linear, or a frequency
        or condition is out of range.
    """
    _require_linear_kelvin_element(parameters)
    draws, size, fabric = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    frequency = checked_frequencies(frequencies)
    fluidity = _dashpot_fluidity(draws, regimes, temperature, size, fabric)
    omega = 2 * np.pi * frequency
    maxwell, kelvin, viscosity = (
        draws[name][..., np.newaxis]
        for name in ("maxwell_modulus", "kelvin_modulus", "kelvin_viscosity")
    )
    kelvin_stiffness = kelvin**2 + (omega * viscosity) ** 2
    storage = (1 / maxwell + kelvin / kelvin_stiffness)[..., np.newaxis, :]
    loss = (omega * viscosity / kelvin_stiffness)[..., np.newaxis, :] + fluidity[
        ..., np.newaxis
    ] / omega
    draw_dimensions = DRAW_DIMENSIONS[size.ndim]
    regime_dimensions = (*draw_dimensions, "regime")
    dimensions = (*regime_dimensions, "frequency")
    return xr.Dataset(
        {
            "tan_delta": (dimensions, loss / storage, {"units": "1"}),
            "storage_compliance": (
                dimensions,
                np.broadcast_to(storage, loss.shape),
                {"units": "1/Pa"},
            ),
            "loss_compliance": (dimensions, loss, {"units": "1/Pa"}),
            "debye_peak": (regime_dimensions, _has_peak(draws, fluidity)),
            "grain_size": (draw_dimensions, size, {"units": "m"}),
            "fabric_factor": (draw_dimensions, fabric, {"units": "1"}),
        },
        coords={
            "frequency": ("frequency", frequency, {"units": "Hz"}),
            "regime": ("regime", [regime.label for regime in regimes]),
            "median_stress": ("regime", [r.median_stress for r in regimes], {"units": "Pa"}),
            "amplitude": ("regime", [r.amplitude for r in regimes], {"units": "Pa"}),
            "temperature": ((), float(temperature), {"units": "K"}),
        },
    )


def _require_linear_kelvin_element(parameters: Mapping[str, npt.ArrayLike]) -> None:
    """Refuse what has no closed form; a linear viscosity of all temperatures is taken as one."""
    for name in KELVIN_REFERENCES:
        if np.any(np.asarray(parameters.get(name, STANDARD_VALUES[name])) != STANDARD_VALUES[name]):
            raise InputError(
                f"{name}: found values other than {STANDARD_VALUES[name]:g}, expected a linear "
                "Kelvin element of one viscosity because the spectrum in closed form needs it; "
                "pyburgers.predictions.imposed_stress simulates the cycles of any other."
            )


def has_debye_peak(
    parameters: Mapping[str, npt.ArrayLike],
    regimes: Sequence[Regime] = PAPER_REGIMES,
    *,
    temperature: float,
    grain_size: npt.ArrayLike,
    fabric_factor: npt.ArrayLike = 1.0,
) -> BoolArray:
    """Whether the peak of the Kelvin element stands out of the dashpot's background.

    With r = E_K/E_M and c = B eta_K the slope of tan(delta) changes sign twice along frequency,
    at a dip and a peak, if and only if (1 + r)(1 + c) > 9 r c, that is r <= 1/8 or
    c < (1 + r)/(8 r - 1); else tan(delta) falls with frequency everywhere.

    Parameters
    ----------
    parameters, regimes, temperature, grain_size, fabric_factor
        As for `attenuation_spectrum`.

    Returns
    -------
    array of bool, shape of the draws + (n_regimes,)

    Raises
    ------
    InputError
        As for `attenuation_spectrum`.
    """
    _require_linear_kelvin_element(parameters)
    draws, size, fabric = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    return _has_peak(draws, _dashpot_fluidity(draws, regimes, temperature, size, fabric))


def predict_attenuation(
    fit: FittedTest,
    frequencies: Sequence[float] | FloatArray = DEFAULT_FREQUENCIES,
    regimes: Sequence[Regime] = PAPER_REGIMES,
    *,
    microstructure: str = "initial",
    temperature: float | None = None,
    grain_size: float | None = None,
    fabric_factor: float | None = None,
) -> xr.Dataset:
    """Spectrum of every posterior draw of a fit.

    Parameters
    ----------
    fit : FittedTest
        A finished fit.
    frequencies, regimes
        As for `attenuation_spectrum`.
    microstructure : {"initial", "steady_state"}
        Initial: the experiment's initial grain size, and F = 1. Steady state: each draw's own
        steady-state grain size and fabric factor. A draw may reach it only at strains beyond the
        test, and then it is an extrapolation, with wide bands. Where grain size follows a
        piezometer the parameter is not a result of the fit but the number that its prior file
        fixes; give `grain_size` for another.
    temperature : float, optional
        K; default the experiment's.
    grain_size, fabric_factor : float, optional
        Take the place of what `microstructure` says; m and 1.

    Returns
    -------
    Dataset
        As of `attenuation_spectrum`, with the chain and draw numbers of the fit, and attributes
        title, experiment, material, data_kind and microstructure.

    Raises
    ------
    InputError
        If `microstructure` is unknown, a number out of range, or the Kelvin element of the fit not
        linear.
    """
    if microstructure not in get_args(Microstructure):
        expected = " or ".join(map(repr, get_args(Microstructure)))
        raise InputError(f"microstructure: found {microstructure!r}, expected {expected}.")
    draws = fit.posterior["posterior"].to_dataset().transpose("chain", "draw", ...)
    experiment = fit.experiment
    frozen: dict[str, tuple[npt.ArrayLike, npt.ArrayLike]] = {
        "initial": (experiment.initial_grain_size, 1.0),
        "steady_state": (draws["steady_state_grain_size"], draws["steady_state_fabric_factor"]),
    }
    size, fabric = frozen[microstructure]
    spectrum = attenuation_spectrum(
        {
            name: draws[name]
            for name in (*PARAMETER_NAMES, BREAKDOWN, *KELVIN_REFERENCES)
            if name in draws
        },
        frequencies,
        regimes,
        temperature=experiment.temperature if temperature is None else temperature,
        grain_size=size if grain_size is None else grain_size,
        fabric_factor=fabric if fabric_factor is None else fabric_factor,
    )
    described = _microstructure_text(microstructure, grain_size, fabric_factor)
    about = f"{experiment.material}, fitted to {experiment.provenance.kind} data"
    conditions = f"{float(spectrum['temperature']):g} K, {described}"
    return spectrum.assign_coords(chain=draws["chain"], draw=draws["draw"]).assign_attrs(
        title=f"{experiment.id} ({about}): {conditions}",
        experiment=experiment.id,
        material=experiment.material,
        data_kind=experiment.provenance.kind,
        microstructure=described,
    )


def quantile_table(spectrum: xr.Dataset) -> pd.DataFrame:
    """Posterior quantiles of tan(delta), a row for each regime and frequency.

    Parameters
    ----------
    spectrum : Dataset
        Of `attenuation_spectrum` or `predict_attenuation`, with draws.

    Returns
    -------
    DataFrame
        Columns median_stress_MPa, amplitude_MPa, frequency_Hz, mean, sd, q5, q25, q50, q75, q95.
    """
    tan_delta = flat_draws(spectrum["tan_delta"])
    n_regimes, n_frequencies = tan_delta.shape[1:]
    by_quantile = np.quantile(tan_delta, np.array(QUANTILES) / 100, axis=0)
    stresses = {
        f"{name}_{STRESS_UNIT}": np.repeat(
            spectrum[name].to_numpy() / UNITS["stress"][STRESS_UNIT], n_frequencies
        )
        for name in ("median_stress", "amplitude")
    }
    return pd.DataFrame(
        {
            **stresses,
            "frequency_Hz": np.tile(spectrum["frequency"].to_numpy(), n_regimes),
            "mean": tan_delta.mean(axis=0).ravel(),
            "sd": tan_delta.std(axis=0).ravel(),
            **{f"q{q}": values.ravel() for q, values in zip(QUANTILES, by_quantile, strict=True)},
        }
    )


def overview_table(spectrum: xr.Dataset) -> pd.DataFrame:
    """Attenuation at a few frequencies for people, a row for each regime.

    Returns
    -------
    DataFrame
        Text. Columns regime, one for each of at most `OVERVIEW_FREQUENCIES` frequencies with
        median and 5 and 95 % of the draws, and Debye peak: the share of draws that have one.
    """
    frequency = spectrum["frequency"].to_numpy()
    n_shown = min(OVERVIEW_FREQUENCIES, frequency.size)
    shown = np.linspace(0, frequency.size - 1, n_shown).round().astype(int)
    low, median, high = np.quantile(flat_draws(spectrum["tan_delta"]), (0.05, 0.5, 0.95), axis=0)
    share = regime_peaks(spectrum).mean(axis=0)
    return pd.DataFrame(
        [
            {
                "regime": str(label),
                **{
                    f"{frequency[i]:.3g} Hz": f"{median[k, i]:.3g} [{low[k, i]:.3g}, "
                    f"{high[k, i]:.3g}]"
                    for i in shown
                },
                "Debye peak": f"{100 * share[k]:.0f} % of draws",
            }
            for k, label in enumerate(spectrum["regime"].to_numpy())
        ]
    )


def save_spectrum(spectrum: xr.Dataset, path: Path) -> None:
    """Write a spectrum as netCDF, in single precision and compressed, in one step.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    encoding = {
        name: {"dtype": "float32", "zlib": True}
        for name, variable in spectrum.data_vars.items()
        if variable.dtype.kind == "f"
    }
    write_atomically(
        path,
        lambda temporary: spectrum.to_netcdf(temporary, engine="h5netcdf", encoding=encoding),
    )


def flat_draws(values: xr.DataArray) -> FloatArray:
    """All draws along the first axis, shape (n_draws, n_regimes, n_frequencies)."""
    ordered = values.transpose(..., "regime", "frequency").to_numpy()
    flat: FloatArray = ordered.reshape(-1, *ordered.shape[-2:])
    return flat


def increasing_frequency(spectrum: xr.Dataset) -> FloatArray:
    """Attenuation along increasing frequency, shape (n_draws, n_regimes, n_frequencies)."""
    return flat_draws(spectrum.sortby("frequency")["tan_delta"])


def regime_peaks(spectrum: xr.Dataset) -> BoolArray:
    """Whether the peak stands out (`has_debye_peak`), shape (n_draws, n_regimes)."""
    peak = spectrum["debye_peak"].transpose(..., "regime").to_numpy()
    flat: BoolArray = peak.reshape(-1, peak.shape[-1])
    return flat


def lowest_slope(spectrum: xr.Dataset) -> FloatArray:
    """Logarithmic slope between the two lowest frequencies, shape (n_draws, n_regimes)."""
    first, second = np.sort(spectrum["frequency"].to_numpy())[:2]
    tan_delta = increasing_frequency(spectrum)
    slope: FloatArray = np.log(tan_delta[..., 1] / tan_delta[..., 0]) / np.log(second / first)
    return slope


def falling_stretch(spectrum: xr.Dataset) -> tuple[FloatArray, FloatArray]:
    """Return the ends (Hz) of where the first regime falls towards low frequency.

    NaN where a draw has no such stretch among the frequencies, shape (n_draws,) each.
    """
    frequency = np.sort(spectrum["frequency"].to_numpy())
    falls = np.diff(increasing_frequency(spectrum)[:, 0], axis=-1) > 0
    some = falls.any(axis=1)
    low = np.where(some, frequency[:-1][falls.argmax(axis=1)], np.nan)
    high = np.where(some, frequency[1:][::-1][falls[:, ::-1].argmax(axis=1)], np.nan)
    return low, high


def _microstructure_text(
    microstructure: str, grain_size: float | None, fabric_factor: float | None
) -> str:
    """Say in words what was frozen."""
    text = f"{microstructure.replace('_', '-')} microstructure"
    if grain_size is not None:
        text += f", grain size {number(grain_size * LENGTH_FACTOR)} {LENGTH_UNIT}"
    if fabric_factor is not None:
        text += f", fabric factor {number(fabric_factor)}"
    return text


def _dashpot_fluidity(
    draws: Mapping[str, FloatArray],
    regimes: Sequence[Regime],
    temperature: float,
    grain_size: FloatArray,
    fabric_factor: FloatArray,
) -> FloatArray:
    """B in 1/(Pa s), shape of the draws + (n_regimes,).

    The trapezoid rule over the period, its nodes half a step away from the extremes of stress:
    both halves of the period give the same sum, so one is enough.
    """
    exponent = draws["stress_exponent"]
    log_factor = draws["activation_enthalpy"] * (draws["beta"] - 1 / (GAS_CONSTANT * temperature))
    log_fluidity = (
        log_factor
        - draws["grain_size_exponent"] * np.log(grain_size)
        - exponent * np.log(fabric_factor)
    )
    breakdown = (draws[BREAKDOWN] * fabric_factor)[..., np.newaxis]
    by_regime = []
    for regime in regimes:
        changes_sign = regime.amplitude > regime.median_stress
        n_nodes = _NODES_SIGN_CHANGE if changes_sign else _NODES
        sine = np.sin(np.pi * ((np.arange(n_nodes) + 0.5) / n_nodes - 0.5))
        stress = regime.median_stress + regime.amplitude * np.append(sine, 1.0)  # and its peak
        weight = 2 / n_nodes * np.sign(stress[:-1]) * sine
        if breakdown.any():
            stress = breakdown * np.sinh(stress / breakdown)
        peak = stress[..., -1]
        # Relative to its peak, stress to the power n neither over- nor underflows.
        relative = stress[..., :-1] / peak[..., np.newaxis]
        mean = np.abs(relative) ** exponent[..., np.newaxis] @ weight
        by_regime.append(np.exp(log_fluidity + exponent * np.log(peak)) / regime.amplitude * mean)
    return np.stack(by_regime, axis=-1)


def _has_peak(draws: Mapping[str, FloatArray], fluidity: FloatArray) -> BoolArray:
    """Evaluate the criterion of `has_debye_peak` from B."""
    ratio = (draws["kelvin_modulus"] / draws["maxwell_modulus"])[..., np.newaxis]
    background = fluidity * draws["kelvin_viscosity"][..., np.newaxis]
    peak: BoolArray = (1 + ratio) * (1 + background) > 9 * ratio * background
    return peak
