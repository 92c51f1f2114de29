"""Tables of attenuation and modulus as a protocol."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.common.errors import InputError
from pyburgers.common.units import span_text
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.attenuation.stan_data import (
    grid_block,
    reference_origin,
    tests_block,
)
from pyburgers.kinds.attenuation.stretched_chart import StretchedChart
from pyburgers.kinds.attenuation.table import MODULUS, NO_READINGS
from pyburgers.kinds.kind import Kind
from pyburgers.model.display import Quantity
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]

TYPICAL_SPREAD = (0.1, 0.01)
"""Of ln(tan delta) and ln(modulus): with stated errors, what residuals are weighed by where not all
errors are stated."""

OUTPUTS_PER_SPECTRUM, PREDICTIONS_PER_SPECTRUM = 60, 25
"""Places in a spectrum of a smooth curve, and of the predictive bands."""


class Attenuation(Kind[AttenuationExperiment]):
    """Stress cycles at many periods and temperatures; responses are tan delta and modulus.

    The clock is the place in the table: spectra, each along the logarithm of the period, stand one
    after the other, those of attenuation first.
    """

    name = "attenuation"
    clock = Quantity("place", "place", "1", "spectra", 1.0)
    response = Quantity("log_reading", "log_reading", "1", "in ln", 1.0)
    noise = "attenuation_scatter"
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = MappingProxyType(
        {
            "grid_log_reading": ("log_reading", "1"),
            "grid_log_reading_replicated": ("log_reading_replicated", "1"),
            "grid_log_relaxation_time": ("log_relaxation_time", "1"),
            "grid_log_maxwell_time": ("log_maxwell_time", "1"),
        }
    )
    warmup = 500
    target_acceptance = 0.98
    chart = StretchedChart()
    points_together = "a row of the table gives attenuation and modulus together"
    load = staticmethod(load_attenuation)
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)

    @property
    def read(self) -> tuple[Quantity, ...]:
        """Attenuation and modulus, both as logarithms."""
        return (
            replace(self.response, display_unit="in ln tan δ"),
            replace(self.response, display_unit="in ln modulus"),
        )

    def check_priors(self, experiment: AttenuationExperiment, priors: PriorSet) -> None:
        """Ask for what the likelihood and a dashpot without known stress need.

        Raise InputError if there is neither a scatter nor a stated error, or the dashpot of a table
        without amplitudes is not linear.
        """
        readings = experiment.readings
        for name, errors in (
            ("attenuation_scatter", readings.tan_delta_error),
            ("modulus_scatter", readings.modulus_error),
        ):
            if errors.size and not np.all(errors > 0) and is_fixed_at(priors[name], 0.0):
                raise InputError(
                    f"{experiment.id}: found readings without a stated error and no {name} in the "
                    f"priors {priors.title!r}, expected a prior of it in them."
                )
        if not experiment.amplitude_is_stated and not is_fixed_at(priors["stress_exponent"], 1.0):
            raise InputError(
                f"{experiment.id}: the amplitude of the stress is not stated, so that only a "
                "linear dashpot is known to answer it, found a stress exponent other than 1 in "
                f"the priors {priors.title!r}, expected amplitudes or the variant maxwell=linear."
            )

    def as_history(self, experiment: AttenuationExperiment) -> AttenuationExperiment:
        """Return the table: the program of loading histories takes it as it is."""
        return experiment

    def without_data(self, experiment: AttenuationExperiment) -> AttenuationExperiment:
        """Return the table without what was read."""
        return replace(experiment, readings=NO_READINGS)

    def prediction_grid(self, experiment: AttenuationExperiment) -> FloatArray:
        """Return places evenly spaced in the logarithm of the period."""
        return _place_grid(experiment, PREDICTIONS_PER_SPECTRUM)

    def output_grid(self, experiment: AttenuationExperiment) -> FloatArray:
        """Return evenly spaced places and those of the rows, of attenuation and of modulus."""
        place = experiment.conditions.place
        rows = np.concatenate([place, place + experiment.conditions.n_spectra])
        return np.union1d(_place_grid(experiment, OUTPUTS_PER_SPECTRUM), rows)

    def solution(
        self, experiment: AttenuationExperiment, draw: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return what would be read without noise: ln(tan delta), then ln(modulus / Pa)."""
        place = draw["grid_place"]
        period, spectrum, quantity = experiment.conditions.at(place)
        return {
            "place": place,
            "is_modulus": (quantity == MODULUS).astype(np.float64),
            "period_s": period,
            "temperature_K": experiment.conditions.temperature[
                experiment.conditions.first_rows[spectrum]
            ],
            "log_reading": draw["grid_log_reading"],
        }

    def solution_table(
        self, experiment: AttenuationExperiment, solution: pd.DataFrame
    ) -> pd.DataFrame:
        """Return tan delta and modulus at the rows of the table."""
        conditions = experiment.conditions
        reading = np.exp(solution.set_index("place")["log_reading"])
        return pd.DataFrame(
            {
                "period_s": conditions.period,
                "temperature_K": conditions.temperature,
                "median_stress_Pa": conditions.median_stress,
                "amplitude_Pa": conditions.amplitude,
                "tan_delta": reading[conditions.place].to_numpy(),
                "modulus_Pa": reading[conditions.place + conditions.n_spectra].to_numpy(),
            }
        )

    def observed_positions(
        self, experiment: AttenuationExperiment
    ) -> dict[str, tuple[FloatArray, str]]:
        """Return places, periods, temperatures, spectra, and errors where all are stated."""
        place = experiment.position
        period, spectrum, quantity = experiment.conditions.at(place)
        rows = experiment.conditions.first_rows[spectrum]
        stated = _stated_errors(experiment)
        has_errors = stated.size > 0 and bool(np.all(stated > 0))
        return {
            "place": (place, "1"),
            "period": (period, "s"),
            "temperature": (experiment.conditions.temperature[rows], "K"),
            "quantity": (quantity.astype(np.float64), "1"),
            "segment": (np.floor(place), "1"),
            **(
                {"reading_error": (stated, "1")}
                if has_errors
                else {"typical_error": (np.hypot(np.array(TYPICAL_SPREAD)[quantity], stated), "1")}
            ),
        }

    def remedy(self, free: Collection[str], along: xr.Dataset) -> str:
        """Propose a band, a peak on top of it, and then to look where temperatures disagree."""
        alone = "fit the temperatures by themselves to see which of them disagrees"
        if "relaxation_time_decades" not in free:
            return (
                "compare laws of the Kelvin part, such as a band of relaxation times (--variant "
                f"kelvin=extended), or {alone}"
            )
        if "peak_strength" not in free:
            return (
                "try a peak on top of the band (--variant kelvin=extended_peak, with priors that "
                f"say where it lies), or {alone}"
            )
        return alone

    def place_text(self, along: xr.Dataset, first: int, last: int) -> str:
        """Return quantity, temperature and periods, such as ``modulus at 1473 K, 10 to 100 s``."""
        period, temperature = (
            along[name].to_numpy()[[first, last]] for name in ("period", "temperature")
        )
        what = "modulus" if along["quantity"][first] else "attenuation"
        return (
            f"{what} at {span_text(temperature, digits=4)} K, "
            f"period {span_text(period, digits=4)} s"
        )

    def with_noise(
        self,
        experiment: AttenuationExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> AttenuationExperiment:
        """Put readings with scatter and stated errors in the place of others."""
        readings = experiment.readings
        n = readings.tan_delta.size
        tan_delta, modulus = np.exp(response[:n]), np.exp(response[n:])
        # As in stan/protocols/attenuation_response.stan.
        tan_delta = np.hypot(tan_delta, readings.tan_delta_error)
        relative_error = readings.modulus_error / readings.modulus
        spreads = (
            np.hypot(values.get("attenuation_scatter", 0.0), readings.tan_delta_error / tan_delta),
            np.hypot(values.get("modulus_scatter", 0.0), relative_error),
        )
        tan_delta, modulus = (
            one * np.exp(spread * rng.standard_normal(one.size))
            for one, spread in zip((tan_delta, modulus), spreads, strict=True)
        )
        noisy = replace(
            readings,
            tan_delta=tan_delta,
            modulus=modulus,
            modulus_error=relative_error * modulus,
        )
        return replace(experiment, readings=noisy)

    def noises(self, experiment: AttenuationExperiment) -> Mapping[str, float | None]:
        """Return the scatters, which may be none where all errors are stated."""
        readings = experiment.readings
        errors = {
            "attenuation_scatter": readings.tan_delta_error,
            "modulus_scatter": readings.modulus_error,
        }
        return {name: 0.0 if np.all(error > 0) else None for name, error in errors.items()}

    def reading_noise(
        self, experiment: AttenuationExperiment, values: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return scatter and stated error of the logarithm of every reading together."""
        n = experiment.readings.tan_delta.size
        scatter = np.stack(
            [
                values["attenuation_scatter" if point < n else "modulus_scatter"]
                for point in range(experiment.n_points)
            ],
            axis=-1,
        )
        return np.asarray(np.hypot(scatter, _stated_errors(experiment)))


def _stated_errors(experiment: AttenuationExperiment) -> FloatArray:
    """Stated errors of the logarithms of readings, 0 where there are none, shape (n_points,)."""
    readings = experiment.readings
    return np.concatenate(
        [
            readings.tan_delta_error / np.maximum(readings.tan_delta, readings.limit),
            readings.modulus_error / readings.modulus,
        ]
    )


def _place_grid(experiment: AttenuationExperiment, per_spectrum: int) -> FloatArray:
    """Places evenly spaced in every spectrum, of attenuation and of modulus."""
    shares = (np.arange(per_spectrum) + 0.5) / per_spectrum
    spectra = np.arange(2 * experiment.conditions.n_spectra)
    return np.asarray((spectra[:, np.newaxis] + shares).ravel())


KIND = Attenuation()
