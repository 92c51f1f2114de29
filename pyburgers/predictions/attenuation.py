"""Attenuation of a pre-stressed nonlinear Burgers material: the exact spectrum, of many draws.

A constant median stress with a sinusoid on top, sigma_m + sigma_0 sin(omega t), drives the
material; its microstructure is frozen. Since stress is imposed, the elements of the series circuit
answer independently, and the strain at the frequency of the cycles is known in closed form for
any power law and any amplitude::

    J1 = 1/E_M(T) + J1_K,  J1_K = E_K/(E_K^2 + omega^2 eta_K^2)
    J2 = J2_K + B/omega,   J2_K = omega eta_K/(E_K^2 + omega^2 eta_K^2)
    tan(delta) = J2/J1
    B  = 1/(pi sigma_0) * integral over 0..2 pi of g(sigma_m + sigma_0 sin x) sin(x) dx
    g(sigma) = sgn(sigma) (|sigma|/F)^n d^-p exp[Q_M (beta - 1/(R T))]

(of a hyperbolic sine with sigma_L sinh[|sigma|/(F sigma_L)] in place of |sigma|/F; J1_K and J2_K
are those of one Kelvin element, those of other laws are in `pyburgers.model.relaxation`).

The dashpot's fluidity B depends on the regime of stresses but not on frequency. Higher harmonics
of the strain and its steady drift do not enter: tan(delta) is that of the fundamental.

The flow law g stands in `pyburgers.predictions.closed_forms` although the physics is otherwise in
``stan/physics/`` alone: a whole posterior times frequencies times regimes is one array expression
this way. Tests compare it with the Stan function ``dashpot_strain_rate`` and the spectrum with
simulations in time (`pyburgers.predictions.imposed_stress`).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.common.netcdf_files import write_netcdf
from pyburgers.model.relaxation import KelvinPart, kelvin_part
from pyburgers.predictions.assumptions import (
    CRITICAL_SHARE,
    checked_share,
    critical_strain,
    cycle_fails,
    hold_fails,
)
from pyburgers.predictions.closed_forms import (
    cycle_strain,
    dashpot_rates,
    fluidity,
    half_period,
)
from pyburgers.predictions.material import Material, fitted_material
from pyburgers.predictions.stress_cycles import (
    DRAW_DIMENSIONS,
    HOLD_TIME,
    PAPER_REGIMES,
    Regime,
    checked_frequencies,
    checked_hold_time,
    checked_inputs,
    modulus_at,
)
from pyburgers.protocols.protocol import FittedTest

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

DEFAULT_FREQUENCIES: tuple[float, ...] = tuple(np.geomspace(1e-4, 1.0, 60).tolist())
"""Frequencies (Hz) of the paper's Fig. 6."""


def attenuation_spectrum(
    parameters: Mapping[str, npt.ArrayLike],
    frequencies: Sequence[float] | FloatArray = DEFAULT_FREQUENCIES,
    regimes: Sequence[Regime] = PAPER_REGIMES,
    *,
    temperature: float,
    grain_size: npt.ArrayLike,
    fabric_factor: npt.ArrayLike = 1.0,
    hold_time: float = HOLD_TIME,
    critical_share: float = CRITICAL_SHARE,
    with_strains: bool = True,
) -> xr.Dataset:
    """Attenuation of every draw in every regime at every frequency (see the module's head).

    Parameters
    ----------
    parameters : mapping of str to array
        Draws of `PARAMETER_NAMES` (SI), all of one shape: ``()``, ``(draw,)`` or ``(chain, draw)``.
        With `pyburgers.predictions.assumptions.EVOLUTION` the result shows failures of frozen
        microstructure. With `pyburgers.model.relaxation.RELAXATION_PARAMETERS` the Kelvin part
        follows another linear law. Other names are ignored.
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
    hold_time : float
        Seconds at the median stress before the cycles; only the strain of the hold depends on it.
    critical_share : float
        Share of the critical strain beyond which frozen microstructure fails.
    with_strains : bool
        False leaves out the strains of the assumption, which take ten times as long as the rest.

    Returns
    -------
    Dataset
        ``tan_delta``, ``storage_compliance`` J1 and ``loss_compliance`` J2 (1/Pa), with dimensions
        of the draws, regime and frequency. ``debye_peak`` says whether dip and peak show at some
        frequency. ``grain_size`` and ``fabric_factor`` are those used. The assumption
        (`pyburgers.predictions.assumptions`) has ``hold_strain``, ``cycle_strain`` (path strain of
        one settled cycle), ``critical_strain``, and ``frozen_fails``, 1 or 0.
        Coordinates ``frequency`` (Hz), ``regime`` (label), ``median_stress`` and ``amplitude``
        (Pa), ``temperature``, ``hold_time``, ``critical_share``.

    Raises
    ------
    InputError
        If a parameter is missing, shapes differ, the Kelvin part is not linear, or a frequency
        or condition is out of range.
    """
    draws, size, fabric = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    frequency = checked_frequencies(frequencies)
    hold_time = checked_hold_time(hold_time)
    omega = 2 * np.pi * frequency
    kelvin = kelvin_part(parameters, temperature, size)
    draws["maxwell_modulus"] = modulus_at(parameters, draws["maxwell_modulus"], temperature)
    storage, kelvin_loss = kelvin.compliance(omega)
    storage = storage + 1 / draws["maxwell_modulus"][..., np.newaxis]
    by_regime: dict[str, list[FloatArray]] = {
        name: [] for name in ("fluidity", "hold", "cycle", "critical")
    }
    for regime in regimes:
        sine = half_period(regime)
        rates = dashpot_rates(
            draws,
            regime,
            np.append(sine, 0.0),
            temperature=temperature,
            grain_size=size,
            fabric_factor=fabric,
        )
        cycling, held = rates[..., :-1], rates[..., -1]
        by_regime["fluidity"].append(fluidity(cycling, sine, regime.amplitude))
        if not with_strains:
            continue
        recoverable = 1 / draws["maxwell_modulus"] + kelvin.creep(hold_time)
        by_regime["hold"].append(regime.median_stress * recoverable + held * hold_time)
        amplitudes = regime.amplitude * storage, regime.amplitude * kelvin_loss
        by_regime["cycle"].append(cycle_strain(cycling, sine, *amplitudes, frequency))
        critical = critical_strain(parameters, size, fabric, regime.median_stress)
        by_regime["critical"].append(critical)
    background = np.stack(by_regime["fluidity"], axis=-1)
    storage, loss = storage[..., np.newaxis, :], kelvin_loss[..., np.newaxis, :]
    loss = loss + background[..., np.newaxis] / omega
    draw_dimensions = DRAW_DIMENSIONS[size.ndim]
    regime_dimensions = (*draw_dimensions, "regime")
    dimensions = (*regime_dimensions, "frequency")
    compliance, number_of_one = {"units": "1/Pa"}, {"units": "1"}
    spectrum = xr.Dataset(
        {
            "tan_delta": (dimensions, loss / storage, number_of_one),
            "storage_compliance": (dimensions, np.broadcast_to(storage, loss.shape), compliance),
            "loss_compliance": (dimensions, loss, compliance),
            "debye_peak": (regime_dimensions, _has_peak(kelvin, draws, background)),
            "grain_size": (draw_dimensions, size, {"units": "m"}),
            "fabric_factor": (draw_dimensions, fabric, number_of_one),
        },
        coords={
            "frequency": ("frequency", frequency, {"units": "Hz"}),
            "regime": ("regime", [regime.label for regime in regimes]),
            "median_stress": ("regime", [r.median_stress for r in regimes], {"units": "Pa"}),
            "amplitude": ("regime", [r.amplitude for r in regimes], {"units": "Pa"}),
            "temperature": ((), float(temperature), {"units": "K"}),
            "hold_time": ((), hold_time, {"units": "s"}),
            "critical_share": ((), checked_share(critical_share), number_of_one),
        },
    )
    if not with_strains:
        return spectrum
    hold, critical = (np.stack(by_regime[name], axis=-1) for name in ("hold", "critical"))
    spectrum = spectrum.assign(
        hold_strain=(regime_dimensions, hold, number_of_one),
        cycle_strain=(dimensions, np.stack(by_regime["cycle"], axis=-2), number_of_one),
        critical_strain=(regime_dimensions, critical, number_of_one),
    )
    fails = (cycle_fails(spectrum) + hold_fails(spectrum)).clip(max=1.0)
    return spectrum.assign(frozen_fails=fails.transpose(*dimensions))


def predict_attenuation(
    fit: FittedTest,
    frequencies: Sequence[float] | FloatArray = DEFAULT_FREQUENCIES,
    regimes: Sequence[Regime] = PAPER_REGIMES,
    *,
    microstructure: str = "initial",
    temperature: float | None = None,
    grain_size: float | None = None,
    fabric_factor: float | None = None,
    elastic_modulus: float | None = None,
    elastic_modulus_sd: float = 0.0,
    hold_time: float = HOLD_TIME,
    critical_share: float = CRITICAL_SHARE,
    with_strains: bool = True,
    seed: int = 1,
) -> xr.Dataset:
    """Spectrum of every posterior draw of a fit.

    Parameters
    ----------
    fit, microstructure, temperature, grain_size, fabric_factor, elastic_modulus, \
    elastic_modulus_sd, seed
        As for `pyburgers.predictions.material.fitted_material`.
    frequencies, regimes, hold_time, critical_share, with_strains
        As for `attenuation_spectrum`.

    Returns
    -------
    Dataset
        As of `material_spectrum`.

    Raises
    ------
    InputError
        If `microstructure` is unknown, a number out of range, the Kelvin element of the fit not
        linear, or the fit a joint one.
    """
    material = fitted_material(
        fit,
        microstructure=microstructure,
        temperature=temperature,
        grain_size=grain_size,
        fabric_factor=fabric_factor,
        elastic_modulus=elastic_modulus,
        elastic_modulus_sd=elastic_modulus_sd,
        seed=seed,
    )
    return material_spectrum(
        material,
        frequencies,
        regimes,
        hold_time=hold_time,
        critical_share=critical_share,
        with_strains=with_strains,
    )


def material_spectrum(
    material: Material,
    frequencies: Sequence[float] | FloatArray,
    regimes: Sequence[Regime],
    *,
    hold_time: float = HOLD_TIME,
    critical_share: float = CRITICAL_SHARE,
    with_strains: bool = True,
) -> xr.Dataset:
    """Spectrum of every draw of a material.

    Parameters
    ----------
    material : Material
        Of `pyburgers.predictions.material.fitted_material`.
    frequencies, regimes, hold_time, critical_share, with_strains
        As for `attenuation_spectrum`.

    Returns
    -------
    Dataset
        As of `attenuation_spectrum`, with the chain and draw numbers of the fit, and the attributes
        of the material.
    """
    spectrum = attenuation_spectrum(
        material.parameters,
        frequencies,
        regimes,
        temperature=material.temperature,
        grain_size=material.grain_size,
        fabric_factor=material.fabric_factor,
        hold_time=hold_time,
        critical_share=critical_share,
        with_strains=with_strains,
    )
    return spectrum.assign_coords(chain=material.chain, draw=material.draw).assign_attrs(
        material.attributes
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
    write_netcdf(path, xr.DataTree(spectrum), {"/": encoding})


def flat_draws(values: xr.DataArray) -> FloatArray:
    """All draws along the first axis, shape (n_draws, n_regimes, n_frequencies)."""
    ordered = values.transpose(..., "regime", "frequency").to_numpy()
    flat: FloatArray = ordered.reshape(-1, *ordered.shape[-2:])
    return flat


def increasing_frequency(spectrum: xr.Dataset) -> FloatArray:
    """Attenuation along increasing frequency, shape (n_draws, n_regimes, n_frequencies)."""
    return flat_draws(spectrum.sortby("frequency")["tan_delta"])


def regime_peaks(spectrum: xr.Dataset) -> BoolArray:
    """Whether the peak stands out, shape (n_draws, n_regimes)."""
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


def _has_peak(
    kelvin: KelvinPart, draws: Mapping[str, FloatArray], dashpot_fluidity: FloatArray
) -> BoolArray:
    """Whether a peak of the Kelvin part stands out of the dashpot's background.

    Of one element, with r = E_K/E_M and c = B eta_K, the slope of tan(delta) changes sign twice
    along frequency, at a dip and a peak, if and only if (1 + r)(1 + c) > 9 r c, that is r <= 1/8 or
    c < (1 + r)/(8 r - 1); else tan(delta) falls with frequency everywhere. Of other laws it is
    looked for at frequencies across all relaxation times, those of a second element or of a peak on
    top of a band among them.
    """
    if kelvin.is_one_element:
        ratio = (draws["kelvin_modulus"] / draws["maxwell_modulus"])[..., np.newaxis]
        viscosity = kelvin.longest_time * draws["kelvin_modulus"]
        background = dashpot_fluidity * viscosity[..., np.newaxis]
        peak: BoolArray = (1 + ratio) * (1 + background) > 9 * ratio * background
        return peak
    below_longest = kelvin.values["peak_time_decades"] + kelvin.values["peak_width"] / np.log(10)
    decades = np.maximum(kelvin.values["relaxation_time_decades"], below_longest).max()
    reach = np.logspace(-3, 3 + decades, int(10 * (6 + decades)))
    omega = reach / kelvin.longest_time[..., np.newaxis]
    storage, loss = kelvin.compliance(omega)
    storage = storage + 1 / draws["maxwell_modulus"][..., np.newaxis]
    rises = [
        (np.diff((loss + of_regime[..., np.newaxis] / omega) / storage, axis=-1) > 0).any(axis=-1)
        for of_regime in np.moveaxis(dashpot_fluidity, -1, 0)
    ]
    return np.stack(rises, axis=-1)
