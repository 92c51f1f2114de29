"""How tests at piecewise constant strain rate are sampled."""

from collections.abc import Sequence
from dataclasses import fields
from itertools import chain

import numpy as np

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, strain_grid
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import (
    MICROSTRUCTURE,
    AtMode,
    Likelihood,
    grid_quantities,
    measured_block,
    strains_of,
)
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.stan_data import StanData, ends
from pyburgers.kinds.valley import (
    FLOWING_SHARE,
    Pins,
    ValleyChart,
    middle_of_rise,
    quantile_pins,
)
from pyburgers.model.parameters import REFERENCE_STRESS_QUANTITY
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import STRAIN, STRESS


class ConstantRateValley(ValleyChart[ConstantRateExperiment]):
    """Pins lie on the curve of stress against strain; ln S_0 belongs to the first rate."""

    def pins(self, test: AtMode[ConstantRateExperiment]) -> Pins:
        """Set the pins where the dashpot carries most of the imposed rate."""
        experiment, mode = test.experiment, test.mode
        observed = test.solution(np.unique(experiment.strain))
        flowing = np.isin(
            experiment.strain,
            observed["grid_strain"][observed["grid_dashpot_share"] >= FLOWING_SHARE],
        )
        pin_strain = quantile_pins(experiment.strain, flowing)
        knots = test.solution(_knot_strain(experiment, pin_strain))
        pin_knot = np.searchsorted(knots["grid_strain"], pin_strain)
        rates = np.array([s.strain_rate for s in experiment.segments])
        first_rate = experiment.segments[0].strain_rate
        stress = knots["grid_stress"]
        time = experiment.time_at(knots["grid_strain"])
        return Pins(
            knot_time=time,
            knot_stress=stress,
            knot=pin_knot,
            unit=rates[experiment.segment_of(pin_strain)],
            path_strain=pin_strain,
            strain_rate=np.ones_like(pin_strain),
            stress_rate=knots["grid_stress_slope"][pin_knot],
            relative_noise=mode.values["stress_noise"] / stress[pin_knot],
            time_spent=np.zeros_like(pin_strain),
            readings=int(flowing.sum()) / pin_strain.size,
            reference_rate=first_rate,
            flow_stress=0.0,
            loading_time=middle_of_rise(time, stress, mode.values["maxwell_modulus"] * first_rate),
            noise="stress_noise",
        )


def _knot_strain(experiment: ConstantRateExperiment, pin_strain: FloatArray) -> FloatArray:
    """Strains of the piecewise linear reference curve: dense at each segment's start."""
    shape = np.union1d(np.geomspace(1e-3, 1.0, 25), np.linspace(0.0, 1.0, 16)[1:])
    return np.asarray(np.union1d(strain_grid(experiment, shape), pin_strain))


REFERENCE_STRESS_SCALE = 0.1
"""Scale of ln S_0: data fix it to about 0.01, the prior to about 1."""


LABORATORY_STRESS = 1e7
"""Origin of the reference stress (Pa) where nothing was observed."""


STEP_ROUNDING = 1e-12
"""Relative distance from a rate step below which a strain counts as the step."""


class ConstantRateLikelihood(Likelihood[ConstantRateExperiment]):
    """Stresses are read along strain."""

    name = "constant_rate"
    clock = STRAIN
    read = (STRESS,)
    response = STRESS
    reference = REFERENCE_STRESS_QUANTITY
    grid_quantities = grid_quantities(
        "stress", "stress_replicated", "kelvin_strain", *MICROSTRUCTURE
    )
    warmup = 300
    target_acceptance = 0.98
    has_fast_solver = True
    chart = ConstantRateValley()

    def reference_origin(self, experiment: ConstantRateExperiment) -> tuple[float, float]:
        """Origin and size of ln S_0: the largest observed stress."""
        stress = experiment.largest_stress if experiment.n_points > 0 else LABORATORY_STRESS
        return float(np.log(stress)), REFERENCE_STRESS_SCALE

    def tests_block(
        self, experiments: Sequence[ConstantRateExperiment], priors: Sequence[PriorSet]
    ) -> StanData:
        """Return the block `stan/data/constant_rate.stan`."""
        outputs = [
            solver_strains(e, np.append(e.strain, strains_of(e.microstructure)))
            for e in experiments
        ]
        at_points, at_measured = (
            [places[part] for (_, _, places), part in zip(outputs, parts, strict=True)]
            for parts in (
                [slice(e.n_points) for e in experiments],
                [slice(e.n_points, None) for e in experiments],
            )
        )
        segments = [segment for e in experiments for segment in e.segments]
        return {
            "segment_end": ends(len(e.segments) for e in experiments),
            "segment_start": [segment.start_strain for segment in segments],
            "segment_rate": [segment.strain_rate for segment in segments],
            "strain_end": ends(strain.size for strain, _, _ in outputs),
            "strain": np.concatenate([strain for strain, _, _ in outputs]).tolist(),
            "n_strains_in_segment": list(chain.from_iterable(counts for _, counts, _ in outputs)),
            "strain_of_point": np.concatenate([places + 1 for places in at_points]).tolist(),
            "point_strain": np.concatenate(
                [strain[places] for (strain, _, _), places in zip(outputs, at_points, strict=True)]
            ).tolist(),
            "measured_end": ends(len(e.microstructure) for e in experiments),
            "strain_of_measured": np.concatenate([places + 1 for places in at_measured]).tolist(),
            "measured": measured_block([e.microstructure for e in experiments]),
            "point_segment": np.concatenate([e.reading_segment for e in experiments]).tolist(),
            "stress_observed": np.concatenate([e.stress for e in experiments]).tolist(),
            "correlated_residuals": int(
                not all(is_fixed_at(own["residual_correlation_strain"], 0.0) for own in priors)
            ),
        }

    def grid_block(
        self, experiments: Sequence[ConstantRateExperiment], grids: Sequence[FloatArray]
    ) -> StanData:
        """Return the strains at which the solutions are reported apart from the observed ones.

        Rate steps are added to a grid, so that the result may be longer; an empty one stays so.
        """
        strains, counts, rates = [], [], []
        for experiment, grid in zip(experiments, grids, strict=True):
            strain, count, _ = solver_strains(experiment, grid)
            if grid.size == 0:
                strain, count = grid, [0] * len(experiment.segments)
            rate = np.array([segment.strain_rate for segment in experiment.segments])
            strains.append(strain)
            counts.append(count)
            rates.append(rate[experiment.segment_of(strain)])
        return {
            "grid_end": ends(strain.size for strain in strains),
            "grid_strain": np.concatenate(strains).tolist(),
            "grid_rate": np.concatenate(rates).tolist(),
            "n_grid_in_segment": list(chain.from_iterable(counts)),
        }

    def grid(self, experiment: ConstantRateExperiment, *, fine: bool = False) -> FloatArray:
        """Return strains, denser at each segment's start; fine ones where stress first rises."""
        first, n = (1e-4, (120, 101)) if fine else (2e-3, (30, 31))
        shape = np.union1d(np.geomspace(first, 1.0, n[0]), np.linspace(0.0, 1.0, n[1])[1:])
        return strain_grid(experiment, shape)

    def along(self, experiment: ConstantRateExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return strains, times since the start, segments from 0, and stated errors."""
        strain, error = experiment.strain, experiment.stress_uncertainty
        stated = {} if error is None else {"reading_error": (np.full_like(strain, error), "Pa")}
        return {
            **super().along(experiment),
            "time": (experiment.time_at(strain), "s"),
            "segment": (experiment.reading_segment.astype(np.float64), "1"),
            **stated,
        }

    def as_history(self, experiment: ConstantRateExperiment) -> HistoryExperiment:
        """Return the test as stages of constant rate.

        The model, the readings and their density are the same; a path strain is the strain.
        """
        starts = np.array([segment.start_strain for segment in experiment.segments])
        times = experiment.time_at(np.append(starts, experiment.final_strain))
        stages = tuple(
            Stage(
                control="strain_rate",
                start_time=float(times[k]),
                end_time=float(times[k + 1]),
                temperature=experiment.temperature,
                value=segment.strain_rate,
            )
            for k, segment in enumerate(experiment.segments)
        )
        stage = experiment.reading_segment
        time = np.clip(experiment.time_at(experiment.strain), times[stage], times[stage + 1])
        shared = {one.name: getattr(experiment, one.name) for one in fields(Experiment)}
        return HistoryExperiment(
            **shared,
            stages=stages,
            time=time,
            reading_stage=stage,
            reading=experiment.stress,
            stress_uncertainty=experiment.stress_uncertainty,
            n_readings_in_file=experiment.n_points,
        )


def solver_strains(
    experiment: ConstantRateExperiment, strain: FloatArray
) -> tuple[FloatArray, list[int], IntArray]:
    """Return where the solver reports for strains, outputs in segments, and places among them.

    A rate step is an output of the segment that ends there. A strain that rounding puts beside a
    step counts as the step: the solver cannot start into so short a segment.
    """
    steps = np.array([segment.start_strain for segment in experiment.segments[1:]])
    snapped = strain.copy()
    for step in steps:
        snapped[np.isclose(strain, step, rtol=STEP_ROUNDING, atol=0.0)] = step
    outputs = np.unique(np.concatenate([snapped, steps]))
    counts = np.bincount(experiment.segment_of(outputs), minlength=len(experiment.segments))
    return outputs, counts.tolist(), np.searchsorted(outputs, snapped)


LIKELIHOOD = ConstantRateLikelihood()
