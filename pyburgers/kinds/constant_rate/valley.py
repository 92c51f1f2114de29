"""What a curve at constant rate fixes: pins of the valley coordinates along strain."""

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, strain_grid
from pyburgers.kinds.likelihood import AtMode
from pyburgers.kinds.valley import (
    FLOWING_SHARE,
    Pins,
    ValleyChart,
    middle_of_rise,
    quantile_pins,
)

FloatArray = npt.NDArray[np.float64]


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
    strain: FloatArray = np.union1d(strain_grid(experiment, shape), pin_strain)
    return strain
