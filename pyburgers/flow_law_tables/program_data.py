"""Data and starts of `stan/rates.stan`, and the lines that are drawn of a law."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.common.units import counted, number
from pyburgers.flow_law_tables.laws import Mechanism, RateLaw, has_environment, without_idle
from pyburgers.flow_law_tables.softening import N_SOFTENING, NO_SOFTENING, SofteningPrior
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.problem import plain_quantity, replaced_by_flow
from pyburgers.kinds.program_data import prior_block
from pyburgers.kinds.stan_data import StanData
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT
from pyburgers.model.parameters import ENVIRONMENT, STANDARD_VALUES
from pyburgers.model.prior_families import FAMILIES
from pyburgers.posterior.labelled_draws import own_name

ROWS_TO_CENTRE = 48.0
"""Rows of a source, times sources, at which a bias is sampled half as it is, half over the spread.

The fewer sources there are, the less is known of the spread."""

TYPICAL_ENTHALPY = 70e3
"""J/mol, for coordinates in which an error of temperature is not mistaken for one of rates."""

LEAST_NARROWING = 0.3
"""Least width of a posterior over that of its prior in the guess of the first metric."""

MOST_LINES = 6
"""Temperatures at which a law is drawn."""

LEAST_RANGE = 2.0
"""Range of temperatures (K) below which all rows belong to one line."""

GROUP_TEMPERATURES = 2.0
"""Widest gap (K) between sorted temperatures of tests of one group."""

GRID_STRESSES = 30
"""Stresses of each line."""

SIGNS = np.array([1.0, -1.0, -1.0 / GAS_CONSTANT])
"""Change of ln(rate) with ln(stress), ln(grain size) and 1/T, over n, p and Q."""

GRID_MARGIN = 1.3
"""Factor by which a line reaches beyond the stresses of its rows."""


@dataclass(frozen=True, eq=False)
class Line:
    """Rows of about one temperature on one drawn line at their mean conditions (K, m, Pa)."""

    rows: IntArray
    temperature: float
    grain_size: float
    stress: FloatArray


def lines(data: RateTable) -> tuple[Line, ...]:
    """Split a table by temperature into at most `MOST_LINES` equal ranges, each with a line."""
    low, width = data.temperature.min(), max(np.ptp(data.temperature), LEAST_RANGE)
    # The largest temperature counts to the last range.
    place = np.minimum((data.temperature - low) / width * MOST_LINES, MOST_LINES - 1).astype(int)
    if np.ptp(data.temperature) < LEAST_RANGE:
        place[:] = 0
    found = []
    for one in np.unique(place):
        rows = np.flatnonzero(place == one)
        at, stress = data.rows(rows).mean_conditions, data.stress[rows]
        grid = np.geomspace(stress.min() / GRID_MARGIN, stress.max() * GRID_MARGIN, GRID_STRESSES)
        found.append(Line(rows, at.temperature, at.grain_size, grid))
    return tuple(found)


def groups(data: RateTable) -> list[tuple[str, IntArray]]:
    """Return sources, or tests of one source by grain size and gap of temperature, behind words."""
    if len(data.sources) > 1:
        return [(f"the rows of {one}", np.flatnonzero(data.source == one)) for one in data.sources]
    found = []
    known = np.nan_to_num(data.grain_size)  # an unknown grain size is one of its own
    for size in np.unique(known):
        alike = np.flatnonzero(known == size)
        ordered = alike[np.argsort(data.temperature[alike], kind="stable")]
        gaps = np.flatnonzero(np.diff(data.temperature[ordered]) > GROUP_TEMPERATURES) + 1
        for rows in np.split(ordered, gaps):
            tests = f"the {rows.size} tests" if rows.size > 1 else "the test"
            grains = f"{number(size * LENGTH_FACTOR)} {LENGTH_UNIT} and " if size else ""
            words = f"{tests} at {grains}about {data.temperature[rows].mean():.4g} K"
            found.append((words, rows))
    return found


def usable_rows(data: RateTable, law: RateLaw) -> RateTable:
    """Leave out rows without a grain size, pressure, fugacity or melt that the law needs."""
    for name in law.needs:
        unknown, words = np.isnan(getattr(data, name)), name.replace("_", " ")
        if unknown.all():
            raise InputError(
                f"{data.id}: no row has a {words}, expected one because {law.priors.title!r} "
                "depends on it; take a law that does not."
            )
        if unknown.any():
            notice = f"{data.id}: {counted(int(unknown.sum()), 'row')} without {words} left out."
            data = replace(data.rows(~unknown), notices=(*data.notices, notice))
    return data


def environment_of(
    law: RateLaw, pressure: FloatArray, water_fugacity: FloatArray, melt_fraction: FloatArray
) -> FloatArray:
    """Return the environment of conditions, (n,) each (Pa, Pa, 1), as `stan/rates.stan` has it.

    Without effect on the law it has no columns. What is unknown has no effect.
    """
    if not has_environment(law):
        return np.empty((pressure.size, 0))
    known = (
        np.where(np.isnan(one), STANDARD_VALUES[name], one)
        for name, one in zip(ENVIRONMENT, (pressure, water_fugacity, melt_fraction), strict=True)
    )
    rows = np.stack([*known], axis=-1)
    rows[:, 1] = np.log(rows[:, 1] / STANDARD_VALUES["water_fugacity"])
    return rows


def law_for(data: RateTable, law: RateLaw) -> RateLaw:
    """Return the law with what counts in no row fixed; rows that are held out need their priors."""
    steady = sorted({*data.enhancement_place.tolist()} - {0})
    return without_idle(law, sources=len(data.sources) > 1, steady=steady)


def rate_data(
    data: RateTable,
    law: RateLaw,
    *,
    held_out: Collection[str] = (),
    softening: SofteningPrior | None = None,
    use_likelihood: bool = True,
) -> StanData:
    """Return all data of `stan/rates.stan`, priors in SI; without likelihood, the prior's."""
    reference, sources = law.reference, data.sources
    is_used = ~np.isin(data.source, list(held_out))
    grain_size = np.where(np.isnan(data.grain_size), reference.grain_size, data.grain_size)
    source = np.array([sources.index(one) for one in data.source])
    n_used = np.bincount(source[is_used], minlength=len(sources))
    distances = [
        np.log(data.stress / reference.stress),
        np.log(grain_size / reference.grain_size),
        1 / data.temperature - 1 / reference.temperature,
    ]
    drawn = lines(data.rows(is_used))
    environment = environment_of(law, *(getattr(data, name) for name in ENVIRONMENT))
    mean_environment = environment[is_used].mean(axis=0)
    mean_distances = [float(np.mean(one[is_used])) for one in distances]
    if mean_environment.size:
        # So that ln(rate) at the mean conditions is the mean of a power law.
        per_kelvin = np.mean(environment[is_used, 0] / data.temperature[is_used])
        mean_environment[0] = per_kelvin / (1 / reference.temperature + mean_distances[2])
    return {
        "n_rows": data.n_rows,
        **{
            name: getattr(data, name).tolist()
            for name in (
                *("stress", "strain_rate", "temperature"),
                *("reading_error", "temperature_error", "grain_size_error"),
            )
        },
        "grain_size": grain_size.tolist(),
        "stress_is_imposed": data.stress_is_imposed.astype(int).tolist(),
        "is_used": is_used.astype(int).tolist(),
        "enhancement_place": data.enhancement_place.tolist(),
        "n_sources": len(sources),
        "source": (source + 1).tolist(),
        "centring": (n_used / (n_used + ROWS_TO_CENTRE / len(sources))).tolist(),
        "typical_slope": [
            TYPICAL_ENTHALPY / GAS_CONSTANT * float(np.mean(data.temperature[source == k] ** -2))
            for k in range(len(sources))
        ],
        "n_mechanisms": len(law.mechanisms),
        "process": [one.process for one in law.mechanisms],
        "has_beta": [int(one.has_beta) for one in law.mechanisms],
        "premelting_temperature": [one.premelting_temperature for one in law.mechanisms],
        "reference_stress": reference.stress,
        "reference_grain_size": reference.grain_size,
        "reference_temperature": reference.temperature,
        **prior_block(law.priors, law.parameters),
        **_coordinate_block(law),
        "mean_conditions": mean_distances,
        "n_environment": environment.shape[1],
        "environment": environment.tolist(),
        "mean_environment": [mean_environment.tolist()],
        "mean_log_rate": float(np.mean(np.log(data.strain_rate[is_used]))),
        "is_softened": int(softening is not None),
        **(softening or NO_SOFTENING).block,
        "use_likelihood": int(use_likelihood),
        "n_grid": len(drawn) * GRID_STRESSES,
        "grid_stress": np.concatenate([one.stress for one in drawn]).tolist(),
        "grid_grain_size": np.repeat(
            [reference.grain_size if np.isnan(one.grain_size) else one.grain_size for one in drawn],
            GRID_STRESSES,
        ).tolist(),
        "grid_environment": np.repeat(
            [environment[is_used][one.rows].mean(axis=0) for one in drawn], GRID_STRESSES, axis=0
        ).tolist(),
        "grid_temperature": np.repeat([one.temperature for one in drawn], GRID_STRESSES).tolist(),
    }


def _coordinate_block(law: RateLaw) -> StanData:
    """Return the plain coordinates of the free parameters."""
    place = {p.name: k for k, p in enumerate(law.parameters, start=1)}
    free = [name for name in place if not law.priors[name].is_fixed]
    flows = {_from_flow(law, one): k for k, one in enumerate(law.mechanisms, start=1)}
    flow_of = [flows.get(name, 0) for name in free]
    through_flow = {k for k, one in enumerate(law.mechanisms, start=1) if one.has_beta}
    rows = [
        (0.0, 1.0, -np.inf, np.inf)
        if mechanism in through_flow
        else plain_quantity(law.priors[name])
        for name, mechanism in zip(free, flow_of, strict=True)
    ]
    return {
        "n_coordinates": len(free),
        "own_parameter": [place[name] for name in free],
        "flow_of": flow_of,
        "quantity": np.array(rows).reshape(len(free), 4).tolist(),
    }


def _from_flow(law: RateLaw, mechanism: Mechanism) -> str | None:
    """Return what follows from the rate at mean conditions: the rate, or Q or beta, if it may."""
    of_law = ("activation_enthalpy", "beta") if mechanism.has_beta else ("mechanism_rate",)
    return replaced_by_flow(law.priors, [own_name(one, mechanism.name) for one in of_law])


def start_of_chain(stan_data: StanData, seed: int, chain: int) -> dict[str, list[float]]:
    """Draw a start of one chain near the middle of the priors, and no bias of any source."""
    rng = np.random.default_rng([seed, chain])
    n_biases = stan_data["n_sources"] if stan_data["n_sources"] > 1 else 0
    centre, width = _prior_coordinates(stan_data)
    start = centre + 0.5 * width * rng.standard_normal(centre.size)
    for k, mechanism in enumerate(stan_data["flow_of"]):
        if mechanism and not stan_data["has_beta"][mechanism - 1]:
            # At the mean conditions of the table the rate of the law is that of its rows.
            place = stan_data["own_parameter"][k]
            rate, *slopes = stan_data["prior_location"][place - 1 : place + 3]
            there = np.array(slopes) @ (np.array(stan_data["mean_conditions"]) * SIGNS)
            start[k] += stan_data["mean_log_rate"] - np.log(rate) - there
    softening = rng.standard_normal(N_SOFTENING * stan_data["is_softened"])
    vectors = {
        "coordinate": start,
        **{
            f"{name}_coordinate": 0.1 * rng.standard_normal(n_biases)
            for name in ("rate", "temperature", "scatter")
        },
        "softening_coordinate": softening,
    }
    return {name: vector.tolist() for name, vector in vectors.items()}


def _prior_coordinates(stan_data: StanData) -> tuple[FloatArray, FloatArray]:
    """Return about the middle and the width of each coordinate under its prior."""
    places = np.array(stan_data["own_parameter"], dtype=np.int64) - 1
    family, location, scale = (
        np.array(stan_data[f"prior_{name}"])[places] for name in ("family", "location", "scale")
    )
    _, unit, lower, upper = np.array(stan_data["quantity"]).reshape(places.size, 4).T
    is_positive = np.isfinite(lower) & np.isinf(upper) & (family == FAMILIES["normal"].code)
    # Of a half-normal prior the middle is about two thirds of its scale.
    ratio = np.where(is_positive, np.maximum((location - lower) / unit, 2 / 3), 1.0)
    width = np.where(is_positive, np.minimum(1.0, 1 / ratio), 1.0)
    width = np.where(family == FAMILIES["lognormal"].code, scale, width)
    return np.where(is_positive, np.log(ratio), 0.0), width


def first_metric(stan_data: StanData) -> list[list[float]]:
    """Guess the covariance of the sampler's vector, diagonal; the more rows, the smaller."""
    n_sources = stan_data["n_sources"]
    counted = np.bincount(
        np.array(stan_data["source"]) - 1, weights=stan_data["is_used"], minlength=n_sources
    )
    n_rows = counted if n_sources > 1 else counted[:0]
    _, width = _prior_coordinates(stan_data)
    variances = [
        (width * max(LEAST_NARROWING, (1 + sum(stan_data["is_used"]) / 20) ** -0.5)) ** 2,
        0.02 + 0.2 / (1 + n_rows),
        np.ones(n_rows.size),
        1 / (1 + n_rows / 8),
        np.ones(N_SOFTENING * stan_data["is_softened"]),
    ]
    metric: list[list[float]] = np.diag(np.concatenate(variances)).tolist()
    return metric
