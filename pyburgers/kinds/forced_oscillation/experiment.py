"""Forced oscillation tests: raw record, or imposed cycles, and what drives the model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, get_args

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError, nearest
from pyburgers.kinds.experiment import Experiment, of_kind
from pyburgers.kinds.forced_oscillation.harmonics import N_HARMONICS, HarmonicFit
from pyburgers.kinds.forced_oscillation.preparation import (
    Background,
    OscillationRecord,
    OscillationSettings,
    PreparedOscillation,
    prepare,
)
from pyburgers.kinds.loading_history.driver import MAX_READINGS
from pyburgers.model.display import STRAIN_FACTOR, STRAIN_UNIT
from pyburgers.model.read_quantities import STRESS

LABORATORY_STRESS = 1e7
"""Stress (Pa) at which the flow rate is told, where none was measured."""


NO_RECORD = OscillationRecord(*[np.empty(0)] * 6)
"""Of a test that can only be simulated."""


@dataclass(frozen=True)
class ImposedCycles:
    """Cycles of the strain: amplitude x sin(2 pi t / period) + mean rate x t, from t = 0.

    `period`: seconds.
    `strain_amplitude`, `cycles`: a fraction, and how many cycles there are.
    `mean_strain_rate`: rate (1/s) of the strain beside the cycles.
    `start_stress`: stress (Pa) at which the model starts, ahead of the cycles.
    """

    period: float
    strain_amplitude: float
    cycles: float
    mean_strain_rate: float = 0.0
    start_stress: float = 0.0

    def prepared(self) -> PreparedOscillation:
        """Return what drives the model, known exactly; there is nothing to compare it with."""
        half = 0.5 * self.cycles * self.period
        rise = self.mean_strain_rate * half
        return PreparedOscillation(
            period=self.period,
            strain_fit=self._exact((rise, rise), self.strain_amplitude, half),
            stress_fit=self._exact((self.start_stress,), LABORATORY_STRESS, half),
            background="kept",
            start_stress=self.start_stress,
            start=0.0,
            time=np.empty(0),
            stress=np.empty(0),
            uncertainty=np.empty(0),
            background_rate=np.array([self.mean_strain_rate]),
            strain_error=np.empty((0, 2 * N_HARMONICS + 1)),
            max_readings=MAX_READINGS,
            notices=(),
        )

    def _exact(self, trend: tuple[float, ...], amplitude: float, half: float) -> HarmonicFit:
        """Return a series without errors: Legendre coefficients of its trend, and a sine."""
        coefficients = np.zeros(len(trend) + 2 * N_HARMONICS)
        coefficients[: len(trend) + 1] = *trend, amplitude
        return HarmonicFit(
            period=self.period,
            n_harmonics=N_HARMONICS,
            degree=len(trend) - 1,
            t_middle=half,
            t_half=half,
            coefficients=coefficients,
            covariance=np.zeros((coefficients.size, coefficients.size)),
            chi_square=0.0,
            n_points=0,
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class OscillationExperiment(Experiment):
    """One forced oscillation test in SI units.

    `initial_grain_size` is that at the start of the record (`prepared.start`).

    Attributes
    ----------
    record : OscillationRecord
        The readings as they were taken.
    settings : OscillationSettings
        How the record is prepared; every choice is a number.
    prepared : PreparedOscillation
        Driving strain and readings for comparison, as the settings give them.
    spin_up_cycles : int
        Cycles of the model ahead of the record, so that no start-up transient is left.
    imposed : ImposedCycles or None
        Driving cycles of a test without a record, which can only be simulated.

    Examples
    --------
    >>> test = pyburgers.load_experiment(data / "olivine" / "olivine_twin.toml")
    >>> test.settings.period
    300.0
    """

    protocol: ClassVar[str] = "forced_oscillation"
    small_strain: ClassVar[float] = 0.0
    points_together: ClassVar[str] = "a record of oscillations is prepared as a whole"
    laws: ClassVar[Mapping[str, Sequence[str]]] = {
        **Experiment.laws,
        "grain_size": ("piezometric", "constant"),
        "fabric": ("constant",),
        "residuals": ("independent",),
    }
    record: OscillationRecord
    settings: OscillationSettings
    prepared: PreparedOscillation
    spin_up_cycles: int
    imposed: ImposedCycles | None = None

    @property
    def end(self) -> float:
        """Time (s) of the last stress, or of the end of imposed cycles."""
        if self.imposed is not None:
            return self.imposed.cycles * self.imposed.period
        return float(self.prepared.time[-1])

    @property
    def position(self) -> FloatArray:
        """Times (s) of the stresses."""
        return self.prepared.time

    @property
    def span(self) -> tuple[float, float]:
        """Start and end (s) of the record, or of imposed cycles."""
        return self.prepared.start, self.end

    @property
    def stress(self) -> FloatArray:
        """Stress (Pa) of `prepared`, for comparison with the model, shape (n_points,)."""
        return self.prepared.stress

    @property
    def response(self) -> FloatArray:
        """Stresses."""
        return self.stress

    def has_readings_of(self, other: Experiment) -> bool:
        """Whether both tests have the same record."""
        if not isinstance(other, OscillationExperiment):
            return False
        return self.n_points > 0 and np.array_equal(self.record.stress, other.record.stress)

    @property
    def n_driving_errors(self) -> int:
        """Number of the errors of the driving strain that take part."""
        return len(self.prepared.strain_error)

    def driving_error(self, true: Self) -> FloatArray:
        """Return the errors of the strain's fit, given a test that knows the true strain."""
        found, wanted = (
            np.concatenate([one.strain_fit.sine, one.strain_fit.cosine, one.background_rate])
            for one in (self.prepared, true.prepared)
        )
        error = self.prepared.strain_error
        if len(error) == 0:
            return np.empty(0)
        size = np.sqrt(np.sum(error**2, axis=0))
        used = size > 0
        scaled, sought = error[:, used] / size[used], (wanted - found)[used] / size[used]
        return np.asarray(np.linalg.lstsq(scaled.T, sought)[0])

    @property
    def noises(self) -> Mapping[str, float | None]:
        """Noise of the stress, beside its stated errors."""
        return {STRESS.noise: None}

    @property
    def largest_stress(self) -> float:
        """Largest |σ| (Pa) that the model is compared with; only of an experiment with data."""
        return float(np.max(np.abs(self.stress)))

    @property
    def largest_strain(self) -> float | None:
        """Largest |ε| of the record; None of imposed cycles."""
        return float(np.max(np.abs(self.record.strain))) if self.record.strain.size else None

    @property
    def title(self) -> str:
        """Sample, material and kind of data; below them period, amplitude and background."""
        prepared = self.prepared
        amplitude, _ = prepared.strain_fit.amplitude()
        return (
            f"{self.id}: {self.material}, {self.temperature:g} K, {self.provenance.kind} data\n"
            f"period {prepared.period:g} s, strain amplitude "
            f"{amplitude * STRAIN_FACTOR:.2g} {STRAIN_UNIT}, background {prepared.background}"
        )

    def to_be_solved(self) -> Self:
        """Return the test driven by its fitted strain as known; the record sets where it starts."""
        known = replace(self.prepared, strain_error=self.prepared.strain_error[:0])
        return replace(self, prepared=known)

    def known_columns(self, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return the strain, without its trend where that is removed, and the fabric."""
        # Oscillating tests have no fabric evolution (Eq. 5 of the paper).
        return {"strain": self.prepared.strain(at), "fabric_factor": np.ones_like(at)}

    def with_noise(
        self, response: FloatArray, values: Mapping[str, float], rng: np.random.Generator
    ) -> Self:
        """Put noisy stresses and strains in the place of others, with the test's settings."""
        template, strain_time = self.prepared, self.record.strain_time
        noise = values["stress_noise"] * template.relative_uncertainty
        strain = template.strain_fit.periodic(strain_time) + template.strain_fit.trend(strain_time)
        strain_noise = self.record.strain_uncertainty
        record = replace(
            self.record,
            strain=strain + strain_noise * rng.standard_normal(strain.size),
            stress_time=template.time,
            stress=response + noise * rng.standard_normal(response.size),
            stress_uncertainty=template.uncertainty,
        )
        # Where the model starts, too: simulated data have no bias before they are there.
        settings = template.settings
        prepared = prepare(record, settings, self.id)
        return replace(self, record=record, settings=settings, prepared=prepared)

    def own_tables(self) -> dict[str, Any]:
        """Return how the record is prepared, and the record; or the imposed cycles."""
        imposed, record, settings = self.imposed, self.record, self.settings
        if imposed is not None:
            return {
                "oscillation": {
                    "period_s": imposed.period,
                    "spin_up_cycles": self.spin_up_cycles,
                    "start_stress_Pa": imposed.start_stress,
                },
                "imposed_cycles": {
                    "strain_amplitude": imposed.strain_amplitude,
                    "cycles": imposed.cycles,
                    "mean_strain_rate_per_s": imposed.mean_strain_rate,
                },
            }
        series = {
            "strain": ("fraction", record.strain_time, record.strain, record.strain_uncertainty),
            "stress": ("Pa", record.stress_time, record.stress, record.stress_uncertainty),
        }
        own = settings.max_readings
        data: dict[str, Any] = {
            "missing": [],
            "max_readings": own if own != MAX_READINGS else None,
        }
        for name, (unit, *columns) in series.items():
            data |= {
                f"{name}_file": dict(zip(("time_s", name, "uncertainty"), columns, strict=True)),
                f"{name}_time_column": "time_s",
                f"{name}_time_unit": "s",
                f"{name}_column": name,
                f"{name}_unit": unit,
                f"{name}_uncertainty_column": "uncertainty",
            }
        oscillation = {
            "period_s": settings.period,
            "strain_trend_degree": settings.strain_trend_degree,
            "stress_trend_degree": settings.stress_trend_degree,
            "background": settings.background,
            "spin_up_cycles": self.spin_up_cycles,
            "start_stress_Pa": settings.start_stress,
        }
        return {"oscillation": oscillation, "data": data}


def with_background(
    experiment: OscillationExperiment, background: Background
) -> OscillationExperiment:
    """Return the same test with its background removed or kept.

    Raises
    ------
    InputError
        If the test is none of a record, or `background` is neither word.

    Examples
    --------
    >>> record = pyburgers.load_experiment(data / "olivine" / "olivine_twin.toml")
    >>> kept = pyburgers.with_background(record, "kept")
    """
    experiment = of_kind(experiment, OscillationExperiment)
    if background not in get_args(Background):
        expected = nearest(background, get_args(Background))
        raise InputError(f"background: found {background!r}, {expected}")
    if experiment.imposed is not None:
        raise InputError(f"{experiment.id}: found imposed cycles, expected a record.")
    settings = replace(experiment.settings, background=background, start_stress=None)
    prepared = prepare(experiment.record, settings, experiment.id)
    others = [one for one in experiment.notices if one not in experiment.prepared.notices]
    notices = (*others, *prepared.notices)
    return replace(experiment, settings=prepared.settings, prepared=prepared, notices=notices)
