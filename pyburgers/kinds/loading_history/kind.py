"""Tests under any loading history as a protocol."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.common.errors import InputError
from pyburgers.common.units import span_text
from pyburgers.kinds.experiment import CONDITION_KEYS, Experiment
from pyburgers.kinds.kind import Kind
from pyburgers.kinds.loading_history.advice import advice
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.measured_sections import section_times
from pyburgers.kinds.loading_history.priors import priors_of, stated_priors
from pyburgers.kinds.loading_history.solution_times import (
    load_times,
    stage_times,
    with_more,
)
from pyburgers.kinds.loading_history.stan_data import (
    grid_block,
    leg_of_times,
    reference_origin,
    tests_block,
    times_of_readings,
)
from pyburgers.kinds.loading_history.valley import LoadingHistoryValley
from pyburgers.model.display import (
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    Quantity,
    time_unit,
)
from pyburgers.model.laws import DASHPOT_LAWS, KELVIN_LAWS
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import variant_of

FloatArray = npt.NDArray[np.float64]

STRESS = Quantity("stress", "stress_Pa", "Pa", STRESS_UNIT, STRESS_FACTOR)
STRAIN = Quantity("strain", "strain", "1", STRAIN_UNIT, STRAIN_FACTOR)


class LoadingHistoryKind(Kind[HistoryExperiment]):
    """Strain or stress is imposed in stages; the other one is read along time."""

    name = "loading_history"
    clock = Quantity("time", "time_s", "s", "s", 1.0)
    response = Quantity("response", "response", "SI", "SI", 1.0)
    noise = "strain_noise"
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = MappingProxyType(
        {
            "grid_stress": ("stress", "Pa"),
            "grid_stress_replicated": ("stress_replicated", "Pa"),
            "grid_strain": ("strain", "1"),
            "grid_strain_replicated": ("strain_replicated", "1"),
            "grid_strain_rate": ("strain_rate", "1/s"),
            "grid_kelvin_strain": ("kelvin_strain", "1"),
            "grid_path_strain": ("path_strain", "1"),
            "grid_grain_size": ("grain_size", "m"),
            "grid_fabric_factor": ("fabric_factor", "1"),
            "grid_grain_size_softening": ("grain_size_softening", "1"),
            "grid_fabric_softening": ("fabric_softening", "1"),
        }
    )
    warmup = 300
    # One chain in some has steps half as long again as the others, and at 0.98 loses trajectories
    # where grains shrink to the bound of their prior (docs/coordinates_trials.md).
    target_acceptance = 0.99
    chart = LoadingHistoryValley()
    load = staticmethod(load_loading_history)
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)
    priors_of = staticmethod(priors_of)

    @property
    def read(self) -> tuple[Quantity, ...]:
        """Stress where strain is imposed, strain where stress is."""
        return STRESS, STRAIN

    def without_data(self, experiment: HistoryExperiment) -> HistoryExperiment:
        """Return the test with its readings, which set the scales of the solution."""
        return replace(experiment, microstructure=())

    def prediction_grid(self, experiment: HistoryExperiment) -> FloatArray:
        """Return times, denser at the start of every stage and of every load of a series."""
        shape = np.union1d(np.geomspace(1e-4, 1, 24), np.linspace(0, 1, 25))
        return with_more(stage_times(experiment, shape), load_times(experiment))

    def output_grid(self, experiment: HistoryExperiment) -> FloatArray:
        """Return times, dense at the start of every stage, those of the readings among them."""
        shape = np.union1d(np.geomspace(1e-5, 1, 80), np.linspace(0, 1, 81))
        return with_more(stage_times(experiment, shape), experiment.time)

    def shown_clock(self, experiment: HistoryExperiment) -> Quantity:
        """Return time in a unit of which the test has at least ten."""
        unit, seconds = time_unit(experiment.end_time)
        return replace(self.clock, display_unit=unit, display_factor=1.0 / seconds)

    def is_read(self, experiment: HistoryExperiment, at: FloatArray) -> npt.NDArray[np.bool_]:
        """Return where strain is imposed, so that stress is read, and where stress is."""
        driven = np.array([leg.driven for leg in experiment.legs])[leg_of_times(experiment, at)]
        return np.stack([driven == "strain", driven == "stress"])

    def solution(
        self, experiment: HistoryExperiment, draw: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return the solution along time; the strain is that which is read."""
        return {
            "time_s": draw["grid_time"],
            "strain": draw["grid_strain"],
            "stress_Pa": draw["grid_stress"],
            "kelvin_strain": draw["grid_kelvin_strain"],
            "grain_size_m": draw["grid_grain_size"],
            "fabric_factor": draw["grid_fabric_factor"],
        }

    def simulated_positions(self, experiment: HistoryExperiment) -> FloatArray:
        """Return the times of the readings, twice where one stands behind a jump."""
        return times_of_readings(experiment)[0]

    def response_in(self, experiment: HistoryExperiment, solution: pd.DataFrame) -> FloatArray:
        """Return stress or strain of every reading."""
        at_readings = solution.iloc[times_of_readings(experiment)[1]]
        is_strain = experiment.response_is_strain
        return np.where(is_strain, at_readings["strain"], at_readings["stress_Pa"])

    def observed_positions(
        self, experiment: HistoryExperiment
    ) -> dict[str, tuple[FloatArray, str]]:
        """Return times, stages from 0, what is read, and stated errors where all have one."""
        is_strain = experiment.response_is_strain
        found = {
            "time": (experiment.time, "s"),
            "segment": (experiment.reading_stage.astype(np.float64), "1"),
            "quantity": (is_strain.astype(np.float64), "1"),
        }
        errors = (experiment.stress_uncertainty, experiment.strain_uncertainty)
        if all(errors[int(kind)] is not None for kind in np.unique(is_strain)):
            of_kinds = np.array([0.0 if error is None else error for error in errors])
            found["reading_error"] = (of_kinds[is_strain.astype(int)], "SI")
        return found

    def place_text(self, along: xr.Dataset, first: int, last: int) -> str:
        """Return a time in the unit of the figures, such as ``time 26.7 to 29.2 days``."""
        time = along["time"].to_numpy()
        unit, seconds = time_unit(time.max())
        return f"time {span_text(time[[first, last]] / seconds, digits=3)} {unit}"

    def remedy(self, free: Collection[str], along: xr.Dataset) -> str | None:
        """Propose other laws and residuals that correlate, if more than one rate was imposed."""
        return advice(free, along)

    def with_noise(
        self,
        experiment: HistoryExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> HistoryExperiment:
        """Put readings with residuals, which may correlate in time, in the place of others."""
        return replace(experiment, reading=response + _draw_residuals(experiment, values, rng))

    def stated_priors(self, experiment: HistoryExperiment) -> tuple[Prior, ...]:
        """Return those of the apparatus and of the zero of the strain."""
        return stated_priors(experiment)

    def check_priors(self, experiment: HistoryExperiment, priors: PriorSet) -> None:
        """Ask for laws without a stress of their own where the load cell is uncertain.

        Where grains follow the stress, ask for times of measured microstructure. Raise InputError
        if one is missing, or there is such a law.
        """
        section_times(experiment, priors)
        variant = variant_of(priors, experiment)
        with_stress = (
            *(("kelvin", law.name) for law in KELVIN_LAWS.values() if law.own_stress),
            *(("maxwell", law.name) for law in DASHPOT_LAWS.values() if law.own_stress),
            ("grain_size", "piezometric"),
        )
        for one in experiment.uncertain:
            for part, law in with_stress:
                if one.parameter == "stress_calibration_error" and getattr(variant, part) == law:
                    raise InputError(
                        f"{experiment.id}: key {CONDITION_KEYS[one.parameter][0]!r}: found "
                        f"{one.sd:g} with {part} = {law}, expected none because loading histories "
                        "with that law take the load cell as known."
                    )

    def noises(self, experiment: HistoryExperiment) -> Mapping[str, float | None]:
        """Return the noises of what is read in its stages."""
        driven = {stage.driven for stage in experiment.stages}
        errors = {
            "strain_noise": ("stress", experiment.strain_uncertainty),
            "stress_noise": ("strain", experiment.stress_uncertainty),
        }
        return {name: error for name, (imposed, error) in errors.items() if imposed in driven}

    def as_history(self, experiment: HistoryExperiment) -> Experiment:
        """Return the test, which is one."""
        return experiment

    def reading_noise(
        self, experiment: HistoryExperiment, values: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return the noise of what each reading is of."""
        none = np.zeros_like(values["stress_noise"])
        strain, stress = (values.get(name, none) for name in ("strain_noise", "stress_noise"))
        is_strain = experiment.response_is_strain
        return np.where(is_strain, strain[:, np.newaxis], stress[:, np.newaxis])

    def without_point(self, experiment: HistoryExperiment, point: int) -> HistoryExperiment:
        """Return the test without a reading."""
        return replace(
            experiment,
            time=np.delete(experiment.time, point),
            reading_stage=np.delete(experiment.reading_stage, point),
            reading=np.delete(experiment.reading, point),
        )


def _draw_residuals(
    experiment: HistoryExperiment, values: Mapping[str, float], rng: np.random.Generator
) -> FloatArray:
    """Residuals (Pa or fraction), shape (n_points,), as `stan/statistics/residuals.stan` says."""
    is_strain, n = experiment.response_is_strain, experiment.n_points
    noise = np.where(is_strain, values.get("strain_noise", 0.0), values["stress_noise"])
    correlation_time = values.get("residual_correlation_time", 0.0)
    if correlation_time == 0:
        return np.asarray(noise * rng.standard_normal(n))
    share = values.get("residual_correlated_share", 1.0)
    part: FloatArray = np.sqrt(share) * rng.standard_normal(n)
    step = np.diff(experiment.time) / correlation_time
    correlation, spread = np.exp(-step), np.sqrt(-np.expm1(-2 * step))
    for k in np.flatnonzero(np.diff(experiment.reading_stage) == 0):
        part[k + 1] = correlation[k] * part[k] + spread[k] * part[k + 1]
    return np.asarray(noise * (part + np.sqrt(1 - share) * rng.standard_normal(n)))


KIND = LoadingHistoryKind()
