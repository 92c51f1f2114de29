"""What a prediction is about: draws of a fitted material, its state, and other things chosen."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from pyburgers.common.array_types import IntArray
from pyburgers.common.draws import FloatArray, evenly_spaced
from pyburgers.common.errors import InputError
from pyburgers.common.units import UNITS, number
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.conditions import environment_ranges, ranges_text
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.closed_forms import with_maxwell_modulus
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT
from pyburgers.model.environment import check_environment
from pyburgers.model.parameters import ALL_ENVIRONMENT_NUMBERS, ENVIRONMENT
from pyburgers.model.variants import variant_of
from pyburgers.predictions.stress_cycles import OTHER_PARAMETERS, PARAMETER_NAMES

Microstructure = Literal["initial", "steady_state"]


@dataclass(frozen=True, eq=False)
class Material:
    """Draws (SI) of a material, shape (n_chains, n_draws), and its state under the stresses.

    Chain and draw are their numbers in the fit. Attributes are title, experiment, material,
    data_kind, microstructure, elastic_modulus, which is empty if it is that of the fit, and
    apparatus, which is "unseen" if the fitted test is one of the material alone.
    """

    parameters: Mapping[str, FloatArray]
    temperature: float
    grain_size: FloatArray
    fabric_factor: FloatArray
    chain: IntArray
    draw: IntArray
    attributes: Mapping[str, str]

    def thinned(self, at_most: int) -> tuple[dict[str, FloatArray], FloatArray, FloatArray]:
        """Return evenly spaced draws: parameters, grain size and fabric factor, shape (n,)."""
        size, fabric = (
            evenly_spaced(values.ravel(), at_most)
            for values in (self.grain_size, self.fabric_factor)
        )
        parameters = {
            name: evenly_spaced(values.ravel(), at_most) for name, values in self.parameters.items()
        }
        return parameters, size, fabric


def fitted_material(
    fit: FittedTest,
    *,
    microstructure: str = "initial",
    temperature: float | None = None,
    grain_size: float | None = None,
    fabric_factor: float | None = None,
    elastic_modulus: float | None = None,
    elastic_modulus_sd: float = 0.0,
    environment: Mapping[str, float] = MappingProxyType({}),
    seed: int = 1,
) -> Material:
    """Return the material of a fit, by arguments of `pyburgers.predict_attenuation`."""
    if microstructure not in get_args(Microstructure):
        expected = " or ".join(map(repr, get_args(Microstructure)))
        raise InputError(f"microstructure: found {microstructure!r}, expected {expected}.")
    experiment = fit.experiment
    draws = fit.posterior["posterior"].to_dataset().transpose("chain", "draw", ...)
    parameters = {
        name: draws[name].to_numpy().astype(np.float64)
        for name in (*PARAMETER_NAMES, *OTHER_PARAMETERS)
        if name in draws and name not in experiment.without_effect
    }
    shape = parameters["maxwell_modulus"].shape
    check_environment(environment)
    for name, value in environment.items():
        parameters[name] = np.full(shape, value)
        numbers = ALL_ENVIRONMENT_NUMBERS[ENVIRONMENT.index(name) :: len(ENVIRONMENT)]
        if not any(np.any(parameters.get(number, 0.0)) for number in numbers):
            raise InputError(
                f"environment: found {name}, on which no rate of the fit depends, expected none or "
                f"a fit with a prior of {numbers[0]} or another one of its kind."
            )
    if elastic_modulus is not None:
        given = _modulus_draws(elastic_modulus, elastic_modulus_sd, shape, seed)
        parameters = with_maxwell_modulus(parameters, given)
    elif elastic_modulus_sd:
        raise InputError(
            f"elastic_modulus_sd: found {elastic_modulus_sd:g} Pa without elastic_modulus, "
            "expected both or none."
        )
    laws, tests = variant_of(fit.priors, experiment), [experiment]
    if isinstance(fit, Fit) and fit.whole is not None:
        # A table tells nothing of what evolves in the other tests.
        laws, tests = fit.whole.variant, [*fit.whole.problem.experiments]
    size, fabric = np.full(shape, experiment.initial_grain_size), np.ones(shape)
    if microstructure == "steady_state":
        unknown = [
            option
            for option, law, given, name in (
                ("--grain-size-um", laws.grain_size, grain_size, "steady_state_grain_size"),
                ("--fabric-factor", laws.fabric, fabric_factor, "steady_state_fabric_factor"),
            )
            if law == "evolving" and given is None and name not in parameters
        ]
        if unknown:
            raise InputError(
                f"microstructure: found 'steady_state', of which {experiment.id} tells nothing, "
                f"expected {' and '.join(unknown)}, or another test of the joint fit."
            )
        size = parameters.get("steady_state_grain_size", size)
        fabric = parameters.get("steady_state_fabric_factor", fabric)
    size = size if grain_size is None else np.full(shape, grain_size)
    fabric = fabric if fabric_factor is None else np.full(shape, fabric_factor)
    any_strain = np.ones(shape)
    # Constant in a fit of tables alone, because nothing is seen to evolve there.
    is_told = any("steady_state_grain_size" not in one.without_effect for one in tests)
    if laws.grain_size == "constant":
        parameters.pop("piezometer_reference_grain_size", None)
    if laws.grain_size == "constant" and is_told:
        parameters |= {"steady_state_grain_size": size, "critical_strain_grain_size": any_strain}
    if laws.fabric == "constant" and is_told:
        parameters |= {"steady_state_fabric_factor": fabric, "critical_strain_fabric": any_strain}
    at = experiment.temperature if temperature is None else temperature
    described = _microstructure_text(microstructure, grain_size, fabric_factor)
    modulus = _modulus_text(elastic_modulus, elastic_modulus_sd)
    conditions = [f"{at:g} K", described]
    conditions += [ranges_text(environment_ranges(environment))] if environment else []
    conditions += [f"elastic modulus {modulus}"] if modulus else []
    about = f"{experiment.material}, fitted to {experiment.provenance.kind} data"
    return Material(
        parameters=parameters,
        temperature=at,
        grain_size=size,
        fabric_factor=fabric,
        chain=draws["chain"].to_numpy(),
        draw=draws["draw"].to_numpy(),
        attributes={
            "title": f"{experiment.id} ({about}): {', '.join(conditions)}",
            "experiment": experiment.id,
            "material": experiment.material,
            "data_kind": experiment.provenance.kind,
            "apparatus": "unseen" * ("apparatus_compliance" in experiment.without_effect),
            "microstructure": described,
            "elastic_modulus": modulus,
        },
    )


def _modulus_draws(
    mean: float, standard_deviation: float, shape: tuple[int, ...], seed: int
) -> FloatArray:
    """Draws of a log-normal elastic modulus, Pa."""
    if not (np.isfinite(mean) and mean > 0):
        raise InputError(f"elastic_modulus: found {mean:g} Pa, expected a positive modulus.")
    if not (np.isfinite(standard_deviation) and standard_deviation >= 0):
        raise InputError(
            f"elastic_modulus_sd: found {standard_deviation:g} Pa, expected 0 or a positive number."
        )
    variance = np.log1p((standard_deviation / mean) ** 2)
    normal = np.random.default_rng(seed).normal(size=shape)
    return np.asarray(mean * np.exp(np.sqrt(variance) * normal - 0.5 * variance))


def _modulus_text(mean: float | None, standard_deviation: float) -> str:
    """Say in words what elastic modulus was given; empty where none was."""
    if mean is None:
        return ""
    scatter = (
        f" ± {number(standard_deviation / UNITS['stress']['GPa'])}" if standard_deviation else ""
    )
    return f"{number(mean / UNITS['stress']['GPa'])}{scatter} GPa"


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
