"""Closed forms of a frozen material under a hold and stress cycles (`stan/stress_cycles.stan`)."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.kinds.attenuation.likelihood import stress_nodes
from pyburgers.kinds.stan_data import ends
from pyburgers.model.laws import DASHPOT_STRESSES
from pyburgers.model.priors import FLOW_LAW
from pyburgers.model.relaxation import KelvinPart
from pyburgers.predictions.stress_cycles import Regime, parameter_columns

DIGITS = 17
"""Of the numbers that the program writes: a grain size in its steady state stays exactly that."""

CYCLE_NODES = 64
"""Nodes in half a period for the strain of a cycle: the kink of |rate| limits it to about 1e-3."""

ELEMENTS = ("maxwell_modulus", "kelvin_modulus", "kelvin_viscosity")

DELAYS_PER_DECADE = 10
"""Where a peak of a Kelvin part with many relaxation times is looked for."""


def closed_forms(
    draws: Mapping[str, FloatArray],
    regimes: Sequence[Regime],
    frequency: FloatArray,
    kelvin: KelvinPart,
    *,
    temperature: float,
    grain_size: FloatArray,
    fabric_factor: FloatArray,
    with_strains: bool,
) -> dict[str, FloatArray]:
    """Return the generated quantities of `stan/stress_cycles.stan`, shape of the draws + their own.

    Conditions are in K, m and 1, frequencies in Hz.
    """
    stresses = [(regime.median_stress, regime.amplitude) for regime in regimes]
    nodes = [stress_nodes(*one) for one in stresses]
    angles = np.pi * ((np.arange(CYCLE_NODES) + 0.5) / CYCLE_NODES - 0.5)
    sine = np.sin(angles) if with_strains else np.empty(0)
    log_delay = _log_delays(kelvin)
    data = {
        "temperature": temperature,
        "n_frequencies": frequency.size,
        "frequency": frequency.tolist(),
        "n_regimes": len(regimes),
        "median_stress": [median for median, _ in stresses],
        "amplitude": [amplitude for _, amplitude in stresses],
        "node_end": ends(len(own) for own in nodes),
        "node": np.concatenate(nodes).tolist(),
        "n_sines": sine.size,
        "sine": sine.tolist(),
        "n_delays": log_delay.size,
        "log_delay": log_delay.tolist(),
    }
    columns = parameter_columns(draws, grain_size.shape)
    materials = np.stack([*columns, grain_size, fabric_factor, np.zeros(grain_size.shape)], axis=-1)
    return _solved(data, materials)


def flow_rate(
    parameters: Mapping[str, npt.ArrayLike],
    stress: npt.ArrayLike,
    *,
    temperature: float,
    grain_size: npt.ArrayLike,
    fabric_factor: npt.ArrayLike = 1.0,
) -> FloatArray:
    """Return the strain rate of the dashpot, the flow law of the model.

    Parameters
    ----------
    parameters : mapping of str to float or array
        SI values of stress_exponent, grain_size_exponent, activation_enthalpy and beta.
        With a breakdown_stress above zero the law is the hyperbolic sine, with a threshold_stress
        that of a threshold. Other names are ignored.
    stress : float or array
        Pa, of either sign.
    temperature : float
        K.
    grain_size, fabric_factor : float or array
        m; 1 is an isotropic fabric.

    Returns
    -------
    array
        1/s; all arguments are broadcast against each other.

    Raises
    ------
    InputError
        If a number is not finite.
    ToolchainError
        If CmdStan or a compiler is missing.
    """
    draws = {
        name: np.asarray(parameters[name], dtype=np.float64)
        for name in (*FLOW_LAW, *DASHPOT_STRESSES)
        if name in parameters
    }
    state = [np.asarray(one, dtype=np.float64) for one in (grain_size, fabric_factor, stress)]
    shape = np.broadcast_shapes(*(one.shape for one in (*draws.values(), *state)))
    # The rate needs no elements; these only keep their compliance finite.
    elements = {name: np.ones(()) for name in ELEMENTS}
    columns = parameter_columns({**elements, **draws}, shape)
    materials = np.stack([*columns, *(np.broadcast_to(one, shape) for one in state)], axis=-1)
    lists = ("frequency", "median_stress", "amplitude", "node", "sine", "log_delay")
    data = {
        "temperature": temperature,
        "node_end": [0],
        **dict.fromkeys(("n_frequencies", "n_regimes", "n_sines", "n_delays"), 0),
        **{name: [] for name in lists},
    }
    return _solved(data, materials)["dashpot_rate"]


def _solved(data: Mapping[str, object], materials: FloatArray) -> dict[str, FloatArray]:
    """Return generated quantities of materials along the last axis, by name.

    Raises `InputError` if a number is not finite, and `SamplingError` if the program stops.
    """
    if not np.isfinite(materials).all():
        raise InputError(
            "parameters: found draws that are not finite, expected finite numbers (SI)."
        )
    shape = materials.shape[:-1]
    program = load_program(stan_directory() / "stress_cycles.stan")
    points = materials.reshape(-1, materials.shape[-1])
    solved, found = program.generate_at(data, "material", points, digits=DIGITS)
    if not solved.all():
        raise SamplingError("The closed form has no value at some draws; check their units (SI).")
    return {
        name: np.reshape(found[name][0], (*shape, *variable.dimensions))
        for name, variable in found.variables.items()
    }


def _log_delays(kelvin: KelvinPart) -> FloatArray:
    """Return ln(angular frequency times longest relaxation time) across all relaxation times.

    A second element, or a peak on top of a band, is covered; one element needs none.
    """
    if kelvin.is_one_element:
        return np.empty(0)
    values = kelvin.values
    below_longest = values["peak_time_decades"] + values["peak_width"] / np.log(10)
    decades = float(np.maximum(values["relaxation_time_decades"], below_longest).max())
    n_delays = int(DELAYS_PER_DECADE * (6 + decades))
    return np.asarray(np.log(10) * np.linspace(-3, 3 + decades, n_delays))
