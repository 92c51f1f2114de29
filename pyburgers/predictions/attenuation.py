"""Attenuation of a pre-stressed nonlinear Burgers material: the exact spectrum, of many draws.

A constant median stress with a sinusoid on top drives the material; its microstructure is frozen.
Since stress is imposed, the elements of the series circuit answer independently, and the strain at
the frequency of the cycles is known in closed form for any flow law g and any amplitude::

    J1 = 1/E_M(T) + J1_K,  J2 = J2_K + B/omega,  tan(delta) = J2/J1
    B  = 1/(pi sigma_0) * integral over 0..2 pi of g(sigma_m + sigma_0 sin x) sin(x) dx

The dashpot's fluidity B depends on the regime of stresses but not on frequency. Higher harmonics
of the strain and its steady drift do not enter: tan(delta) is that of the fundamental.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, require_type
from pyburgers.common.netcdf_files import write_netcdf
from pyburgers.common.units import UNITS
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import A_FIT
from pyburgers.kinds.conditions import doubtful_conditions, environment_ranges, longer_than_tests
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.closed_forms import closed_forms, require_no_backstress, require_standard
from pyburgers.model.display import STRESS_UNIT
from pyburgers.model.environment import acting_environment
from pyburgers.model.laws import NONLINEAR_KELVIN_PARAMETERS
from pyburgers.predictions.material import (
    CRITICAL_SHARE,
    Material,
    critical_strain,
    fitted_material,
    frozen_limit_texts,
    probability,
    strain_fails,
)
from pyburgers.predictions.stress_cycles import (
    A_REGIME,
    DRAW_DIMENSIONS,
    HOLD_TIME,
    PAPER_REGIMES,
    Regime,
    asked_conditions,
    checked_frequencies,
    checked_inputs,
    checked_number,
    cycles_data,
)

AXIAL = (
    "The fitted table was read in shear, and this spectrum is one of axial stress, with smaller "
    "losses; pyburgers export has compliances in shear."
)
"""Caution of predictions from a table in shear."""

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
        With `pyburgers.predictions.stress_cycles.EVOLUTION` the result shows failures of frozen
        microstructure. With `pyburgers.model.closed_forms.RELAXATION_PARAMETERS` the Kelvin part
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
        False leaves out the strains of the assumption, which take half of the time.

    Returns
    -------
    Dataset
        ``tan_delta``, ``storage_compliance`` J1 and ``loss_compliance`` J2 (1/Pa), with dimensions
        of the draws, regime and frequency. ``elastic_compliance`` is 1/E_M(T) of the draws (1/Pa).
        ``debye_peak`` says whether dip and peak show at some frequency. ``grain_size`` and
        ``fabric_factor`` are those used. The assumption (`pyburgers.predictions.material`) has
        ``hold_strain``, ``cycle_strain`` (path strain of one settled cycle), ``critical_strain``,
        and ``frozen_fails``, 1 or 0.
        Coordinates ``frequency`` (Hz), ``regime`` (label), ``median_stress`` and ``amplitude``
        (Pa), ``temperature``, ``hold_time``, ``critical_share``.

    Raises
    ------
    InputError
        If a parameter is missing, shapes differ, the Kelvin part is not linear, or a frequency
        or condition is out of range.
    ToolchainError
        If CmdStan or a compiler is missing.

    Examples
    --------
    >>> spectrum = pyburgers.attenuation_spectrum(
    ...     values, [0.01, 0.1], [pyburgers.Regime(1e6, 1e5)], temperature=260.0, grain_size=2e-4
    ... )
    >>> spectrum["tan_delta"].shape
    (1, 2)
    """
    if not regimes:
        raise InputError("regimes: found none, expected at least one, as pyburgers.Regime.")
    draws, size, fabric = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    frequency = checked_frequencies(frequencies)
    hold_time = checked_number("hold_time", hold_time, " of s")
    require_standard(
        parameters,
        NONLINEAR_KELVIN_PARAMETERS,
        "a linear Kelvin part because the spectrum in closed form needs it; simulate cycles of any "
        "other as a loading history",
    )
    require_no_backstress(parameters)
    found = closed_forms(
        draws,
        size,
        temperature=temperature,
        fabric_factor=fabric,
        asked=cycles_data(regimes, frequency, hold_time, with_strains=with_strains),
    )
    storage = found["storage_compliance"][..., np.newaxis, :]
    background = found["fluidity"][..., np.newaxis] / (2 * np.pi * frequency)
    loss = found["kelvin_loss"][..., np.newaxis, :] + background
    draw_dimensions = DRAW_DIMENSIONS[size.ndim]
    regime_dimensions = (*draw_dimensions, "regime")
    dimensions = (*regime_dimensions, "frequency")
    compliance, number_of_one = {"units": "1/Pa"}, {"units": "1"}
    spectrum = xr.Dataset(
        {
            "tan_delta": (dimensions, loss / storage, number_of_one),
            "storage_compliance": (dimensions, np.broadcast_to(storage, loss.shape), compliance),
            "loss_compliance": (dimensions, loss, compliance),
            "elastic_compliance": (draw_dimensions, 1 / found["maxwell_modulus"], compliance),
            "debye_peak": (regime_dimensions, found["has_peak"] > 0),
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
            "critical_share": ((), checked_number("critical_share", critical_share), number_of_one),
        },
    )
    if not with_strains:
        return spectrum
    recoverable = 1 / found["maxwell_modulus"] + found["kelvin_creep_of_hold"]
    median_stress = spectrum["median_stress"].to_numpy()
    hold = median_stress * recoverable[..., np.newaxis] + found["held_rate"] * hold_time
    critical = critical_strain(draws, size, fabric, found["wanted_grain_size"], found["steepness"])
    spectrum = spectrum.assign(
        hold_strain=(regime_dimensions, hold, number_of_one),
        cycle_strain=(dimensions, found["cycle_strain"], number_of_one),
        critical_strain=(regime_dimensions, critical, number_of_one),
    )
    fails = strain_fails(spectrum, "cycle_strain") + strain_fails(spectrum, "hold_strain")
    return spectrum.assign(frozen_fails=fails.clip(max=1.0).transpose(*dimensions))


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
    environment: Mapping[str, float] = MappingProxyType({}),
    hold_time: float = HOLD_TIME,
    critical_share: float = CRITICAL_SHARE,
    with_strains: bool = True,
    seed: int = 1,
) -> xr.Dataset:
    """Spectrum of every posterior draw of a fit.

    Parameters
    ----------
    fit : FittedTest
        A finished fit of one test, or what a joint fit says of one, such as ``fit["PIL40"]``.
    microstructure : {"initial", "steady_state"}
        Initial: the experiment's initial grain size, and F = 1. Steady state: each draw's own grain
        size and fabric factor, with wide bands if the test does not reach it. Under a piezometer
        the grain size is the number that the prior file fixes; give `grain_size` for another.
    temperature : float, optional
        K; default the experiment's.
    grain_size, fabric_factor : float, optional
        m and 1; take the place of those of `microstructure`.
    elastic_modulus, elastic_modulus_sd : float, optional
        Pa; mean and standard deviation of a log-normal distribution that takes the place of E_M.
        Of a test at constant rate, E_M is mostly the stiffness of the apparatus.
    environment : mapping of str to float
        Pressure (Pa), water_fugacity (Pa) and melt_fraction; default the experiment's.
    seed : int
        Of the draws of the elastic modulus.
    frequencies, regimes, hold_time, critical_share, with_strains
        As for `attenuation_spectrum`.

    Returns
    -------
    Dataset
        As of `attenuation_spectrum`, with the chain and draw numbers of the fit, and attributes
        that say what was predicted. Of a `Fit` the attribute ``cautions`` has a line for each
        thing that is wrong with the fit, or that lies beyond what was fitted.

    Raises
    ------
    InputError
        If `microstructure` is unknown, a number out of range, the Kelvin element of the fit not
        linear, or the fit a joint one. If no rate of the fit depends on a given `environment`.

    Examples
    --------
    >>> spectrum = pyburgers.predict_attenuation(fit, [0.001, 0.01, 0.1])
    >>> middle = spectrum["tan_delta"].median(("chain", "draw"))
    """
    require_type("regimes", regimes, Sequence, "a list, such as [pyburgers.Regime(1e6, 1e5)]")
    for one in regimes:
        require_type("regimes", one, Regime, A_REGIME)
    require_type("fit", fit, FittedTest, A_FIT)
    material = fitted_material(
        fit,
        microstructure=microstructure,
        temperature=temperature,
        grain_size=grain_size,
        fabric_factor=fabric_factor,
        elastic_modulus=elastic_modulus,
        elastic_modulus_sd=elastic_modulus_sd,
        environment=environment,
        seed=seed,
    )
    spectrum = material_spectrum(
        material,
        frequencies,
        regimes,
        hold_time=hold_time,
        critical_share=critical_share,
        with_strains=with_strains,
    )
    if not isinstance(fit, Fit):
        return spectrum
    asked = asked_conditions(
        [material.temperature], grain_size, frequencies=frequencies, regimes=regimes
    )
    stated = {**fit.experiment.environment, **environment}
    there = {**asked, **material.dashpot_rates(regimes), **environment_ranges(stated)}
    acting = acting_environment(material.parameters)
    cautions = (
        *fit.cautions,
        *doubtful_conditions(fit.experiment.material, there, fit.fitted_conditions, acting),
        *longer_than_tests(asked, (fit.whole or fit).problem.experiments),
        *([] if fit.experiment.poisson_ratio_in_shear is None else [AXIAL]),
    )
    return spectrum.assign_attrs(cautions="\n".join(cautions), which_draws=fit.which_draws)


def material_spectrum(
    material: Material,
    frequencies: Sequence[float] | FloatArray,
    regimes: Sequence[Regime],
    **options: Any,
) -> xr.Dataset:
    """Return the `attenuation_spectrum` of a material, with its attributes."""
    spectrum = attenuation_spectrum(
        material.parameters, frequencies, regimes, **material.state, **options
    )
    return spectrum.assign_coords(chain=material.chain, draw=material.draw).assign_attrs(
        material.attributes
    )


def save_spectrum(spectrum: xr.Dataset, path: Path) -> None:
    """Write a spectrum as netCDF, in single precision and compressed, in one step."""
    encoding = {
        name: {"dtype": "float32", "zlib": True}
        for name, variable in spectrum.data_vars.items()
        if variable.dtype.kind == "f"
    }
    write_netcdf(path, xr.DataTree(spectrum), {"/": encoding})


def flat_draws(values: xr.DataArray) -> FloatArray:
    """All draws along the first axis, shape (n_draws, n_regimes, n_frequencies)."""
    ordered = values.transpose(..., "regime", "frequency").to_numpy()
    return np.asarray(ordered.reshape(-1, *ordered.shape[-2:]))


def evolving_quantiles(values: xr.DataArray) -> FloatArray:
    """Quantiles over draws, some of which may be infinite; (3, n_regimes, n_frequencies)."""
    shares = np.array(BAND_PERCENTAGES) / 100
    return np.asarray(np.quantile(flat_draws(values), shares, axis=0, method="nearest"))


def condition_columns(spectrum: xr.Dataset) -> dict[str, FloatArray]:
    """Return columns median_stress_MPa, amplitude_MPa, frequency_Hz by regime, then frequency."""
    frequency = spectrum["frequency"].to_numpy()
    stresses = {
        f"{name}_{STRESS_UNIT}": spectrum[name].to_numpy() / UNITS["stress"][STRESS_UNIT]
        for name in ("median_stress", "amplitude")
    }
    return {
        **{name: np.repeat(values, frequency.size) for name, values in stresses.items()},
        "frequency_Hz": np.tile(frequency, spectrum["regime"].size),
    }


QUANTILES = (5, 25, 50, 75, 95)
"""Percentages of `quantile_table`."""

BAND_PERCENTAGES = (5, 50, 95)
"""Percentages of `evolving_quantiles`."""

OVERVIEW_FREQUENCIES = 5
"""Columns of `overview_table`."""


def quantile_table(spectrum: xr.Dataset) -> pd.DataFrame:
    """Return posterior quantiles of tan(delta), a row for each regime and frequency.

    Strains are medians. Of p_hold_fails, p_cycle_fails and p_frozen_fails each is the share of
    draws in which the hold, a cycle, or one of them strains too much for frozen microstructure.
    """
    tan_delta = flat_draws(spectrum["tan_delta"])
    n_frequencies = tan_delta.shape[2]
    by_hold = probability(strain_fails(spectrum, "hold_strain"))
    by_quantile = np.quantile(tan_delta, np.array(QUANTILES) / 100, axis=0)
    strains = spectrum[["hold_strain", "cycle_strain"]]
    medians = strains.median({*strains.dims} - {"regime", "frequency"}).transpose("regime", ...)
    return pd.DataFrame(
        {
            **condition_columns(spectrum),
            "mean": tan_delta.mean(axis=0).ravel(),
            "sd": tan_delta.std(axis=0).ravel(),
            **{f"q{q}": values.ravel() for q, values in zip(QUANTILES, by_quantile, strict=True)},
            "hold_strain": np.repeat(medians["hold_strain"].to_numpy(), n_frequencies),
            "cycle_strain": medians["cycle_strain"].to_numpy().ravel(),
            "p_hold_fails": np.repeat(by_hold, n_frequencies),
            "p_cycle_fails": probability(strain_fails(spectrum, "cycle_strain")).ravel(),
            "p_frozen_fails": probability(spectrum["frozen_fails"]).ravel(),
        }
    )


def overview_table(spectrum: xr.Dataset) -> pd.DataFrame:
    """Return median and 5 and 95 % of draws at a few frequencies as text, a row for each regime."""
    frequency = spectrum["frequency"].to_numpy()
    n_shown = min(OVERVIEW_FREQUENCIES, frequency.size)
    shown = np.linspace(0, frequency.size - 1, n_shown).round().astype(int)
    low, median, high = np.quantile(flat_draws(spectrum["tan_delta"]), (0.05, 0.5, 0.95), axis=0)
    share = probability(spectrum["debye_peak"])
    frozen = frozen_limit_texts(spectrum)
    return pd.DataFrame(
        [
            {
                "regime": str(label),
                "frozen microstructure": frozen[k],
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
