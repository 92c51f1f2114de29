"""Conditions of a test: unlikely ones, those that it passes, and those outside what was fitted."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
import xarray as xr

from pyburgers.common.array_types import FloatArray
from pyburgers.common.messages import tell_notes
from pyburgers.common.units import UNITS, number
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.kind import solution_columns
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.model.arrhenius import log_flow_rate
from pyburgers.model.environment import acting_environment
from pyburgers.model.laws import DASHPOT_STRESSES, DISLOCATIONS_SWITCH, HARDENING_SWITCH
from pyburgers.model.parameters import ENVIRONMENT, STANDARD_VALUES
from pyburgers.model.plausible import PlausibleRanges, plausible_ranges
from pyburgers.model.prior_families import is_fixed_at, is_standard
from pyburgers.model.priors import FLOW_LAW, PriorSet, default_priors, shipped_prior_files
from pyburgers.model.unlikely_numbers import range_of, unlikely_numbers, unlikely_priors

LIKELY_GRAIN_SIZES = (1e-8, 0.05)
"""Grain sizes (m) outside of which a unit may be wrong."""


FIRST_READINGS, LEAST_SHARE, MOST_STIFFNESS = 3, 0.1, 5.0
"""First readings of a test, the share of the largest stress below which they tell nothing, and
the ratio to the largest usual Maxwell modulus beyond which a unit or a zero may be wrong."""

SOFTEST, TINY_STRAIN = 0.01, 1e-12
"""Share of the least usual Maxwell modulus below which that of an oscillation may have a wrong
unit; strain that stands for none in a quotient."""

FLOW_DRAWS, TAIL, FAR_FROM_FLOW = 500, 0.025, 3.0
"""Draws of the flow law from its priors, the share of them beyond each end of their range, and the
factor beyond these ends at which the largest stress of a test speaks against the priors."""

OTHER_FLOWS = (*DASHPOT_STRESSES, HARDENING_SWITCH, DISLOCATIONS_SWITCH, "second_rate")
MODULI = ("maxwell_modulus", "kelvin_modulus")

LIKELY_PRESSURES = 1e4, 3e10
"""Least and largest pressure (Pa) but zero that presses of laboratories hold."""

MIN_LIKELY_STRESS = 1e3
"""Largest stress (Pa) of a test below which a unit may be wrong."""


def doubts(experiment: Experiment) -> list[str]:
    """Say which numbers of a test are unlikely, and whether its material has no default priors."""
    found = unlikely_in(experiment)
    if plausible_ranges(experiment.material) is None:
        found.append(
            f"{experiment.id}: there are no default priors of {experiment.material!r}, so that a "
            "fit needs --priors."
        )
    return found


def prior_doubts(priors: PriorSet, tests: Sequence[Experiment]) -> tuple[str, ...]:
    """Say what is unlikely about the priors of some tests of a material."""
    of_tests = (sentence for test in tests for sentence in _unlikely_flow(test, priors))
    return (*unlikely_priors(priors, tests[0].material), *of_tests)


def tell_doubts(*inputs: tuple[PriorSet, Sequence[Experiment]]) -> None:
    """Note what tests and their priors say, each sentence once."""
    sentences: list[str] = []
    for priors, tests in inputs:
        for test in tests:
            sentences += (*test.notices, *doubts(test))
        sentences += prior_doubts(priors, tests)
    tell_notes(sentences)


def _unlikely_flow(experiment: Experiment, priors: PriorSet) -> Iterator[str]:
    """Say if a test at constant rates reaches stresses far from those at which its dashpot flows.

    It may stay far below them as long as its strain may be elastic. Only power laws alone count.
    """
    acts = {name: not is_fixed_at(prior, 0.0) for name, prior in priors.priors.items()}
    more = (name for name in OTHER_FLOWS if not is_standard(priors.priors, name))
    if (
        not isinstance(experiment, ConstantRateExperiment)
        or not experiment.n_points
        or any(more)
        or acting_environment(acts)
    ):
        return
    drawn = _drawn_flow_law(priors)
    at = {"grain_size": experiment.initial_grain_size, "temperature": experiment.temperature}
    log_rate = log_flow_rate(drawn, stress=1.0, **at)
    rates = np.log([segment.strain_rate for segment in experiment.segments])
    slow, fast = ((end - log_rate) / drawn["stress_exponent"] for end in (min(rates), max(rates)))
    low, high = float(np.quantile(slow, TAIL)), float(np.quantile(fast, 1.0 - TAIL))
    softest = 1.0 / sum(1.0 / (range_of(priors[name]) or (np.inf,))[0] for name in MODULI)
    reached, elastic = np.log([experiment.largest_stress, softest * np.ptp(experiment.strain)])
    margin = np.log(FAR_FROM_FLOW)
    if reached > high + margin or reached < min(low, elastic) - margin:
        with np.errstate(over="ignore"):
            ends = " to ".join(f"{np.exp(end) / 1e6:.3g}" for end in (low, high))
        yield (
            f"{experiment.id}: with these priors the dashpot flows at {ends} MPa, the data reach "
            f"{experiment.largest_stress / 1e6:.3g} MPa: check n, Q_M and beta together."
        )


def _drawn_flow_law(priors: PriorSet) -> dict[str, FloatArray]:
    """Return draws (n,) of n, p, Q_M and beta."""
    rng = np.random.default_rng(1)
    if priors.flow_law is not None:
        rows = [priors.flow_law.sample(rng) for _ in range(FLOW_DRAWS)]
        return {name: np.array([row[name] for row in rows]) for name in FLOW_LAW}
    return {
        name: np.full(FLOW_DRAWS, priors[name].location)
        if priors[name].is_fixed
        else priors[name].distribution().rvs(FLOW_DRAWS, random_state=rng)
        for name in FLOW_LAW
    }


def unlikely_in(experiment: Experiment) -> list[str]:
    """Say which numbers of a test are unlikely; each sentence starts with its name."""
    found = (*_of_conditions(experiment), *experiment.doubts)
    return [f"{experiment.id}: {sentence}" for sentence in found]


def _of_conditions(experiment: Experiment) -> Iterator[str]:
    """Say which grain size, temperatures, stresses and moduli are unlikely."""
    material = experiment.material
    yield from unlikely_grain_size(np.array([experiment.initial_grain_size]))
    yield from unlikely_temperature(material, *temperature_range(experiment))
    yield from unlikely_pressure(np.array([experiment.environment.get("pressure", np.nan)]))
    imposed = isinstance(experiment, HistoryExperiment) and experiment.imposed_stresses.size
    known = experiment.n_points or imposed
    of_stress = [*unlikely_stress(material, experiment.largest_stress)] if known else []
    yield from of_stress
    if isinstance(experiment, AttenuationExperiment) and experiment.readings.modulus.size:
        largest = experiment.elasticity.axial_modulus(float(experiment.readings.modulus.max()))
        for sentence in unlikely_numbers(material, {"maxwell_modulus": (largest, largest)}):
            yield f"the largest modulus, as {sentence}"
    if experiment.n_points and not of_stress:
        yield from _unlikely_stiffness(experiment)


def _unlikely_stiffness(experiment: Experiment) -> Iterator[str]:
    """Say if a test starts far stiffer than its material is, or is as soft as no material is."""
    if experiment.material not in shipped_prior_files():
        return
    first, softest = slice(max(FIRST_READINGS, experiment.n_points // 50)), 0.0
    what, zeros = "the first readings", "units and zeros of stress and strain"
    match experiment:
        case ConstantRateExperiment():
            stress, strain = experiment.stress[first].mean(), experiment.strain[first].mean()
        case HistoryExperiment(strain_offset=None) if (
            experiment.stages[0].control == "stress" and experiment.response_is_strain[first].all()
        ):
            stress = abs(experiment.stages[0].value)
            strain = abs(experiment.reading[first].mean())
            zeros += ", the start of the load, and [strain_offset]"
        case OscillationExperiment():
            fits = experiment.prepared.stress_fit, experiment.prepared.strain_fit
            (stress, _), (strain, _) = (fit.amplitude() for fit in fits)
            what, softest = "the oscillation", SOFTEST
        case _:
            return
    if softest == 0 and stress <= LEAST_SHARE * experiment.largest_stress:
        return
    usual = range_of(default_priors(experiment.material)["maxwell_modulus"]) or (0.0, np.inf)
    if not softest * usual[0] * strain <= stress <= MOST_STIFFNESS * usual[1] * strain:
        found = float(stress / max(strain, TINY_STRAIN)) / 1e9
        least, most = (end / 1e9 for end in usual)
        yield (
            f"stress over strain of {what} is {found:.3g} GPa, while priors of "
            f"{experiment.material} expect a Maxwell modulus of {least:.3g} to {most:.3g} GPa. "
            f"Check {zeros}."
        )


def unlikely_grain_size(sizes: FloatArray) -> Iterator[str]:
    """Say if the smallest or the largest grain size (m) of tests is unlikely; NaN is unknown."""
    for size in _beyond(sizes, LIKELY_GRAIN_SIZES):
        yield f"grains of {size:g} m are unlikely; 230 um is 230e-6."


def unlikely_pressure(pressures: FloatArray) -> Iterator[str]:
    """Say the same of pressures (Pa); none is likely."""
    for found in _beyond(np.where(pressures == 0, np.nan, pressures), LIKELY_PRESSURES):
        yield f"a pressure of {found:g} Pa is unlikely; check its unit."


def _beyond(values: FloatArray, likely: tuple[float, float]) -> Iterator[float]:
    """Yield the smallest and the largest of values beyond likely ones; NaN is unknown."""
    for found in dict.fromkeys((np.fmin.reduce(values), np.fmax.reduce(values))):
        if found < likely[0] or found > likely[1]:
            yield float(found)


def unlikely_temperature(material: str, coldest: float, hottest: float) -> Iterator[str]:
    """Say where temperatures (K) of tests are unlikely in a material."""
    ranges = _ranges(material)
    melting, least = ranges.melting_temperature_K, ranges.least_temperature_K
    if melting is not None and hottest > melting:
        yield f"{material} at {hottest:g} K is molten (from {melting:g} K); check the temperature."
    if least is not None and coldest < least:
        yield f"{material} at {coldest:g} K is unlikely (from {least:g} K); check the temperature."


def unlikely_stress(material: str, largest: float) -> Iterator[str]:
    """Say where the largest stress (Pa) of tests is unlikely in a material."""
    limit = _ranges(material).largest_stress_MPa
    if largest > limit * 1e6:
        yield (
            f"a stress of {largest / 1e9:g} GPa is unlikely in {material} (up to {limit:g} MPa is "
            "plausible); check its unit."
        )
    elif 0 < largest < MIN_LIKELY_STRESS:
        yield f"a largest stress of {largest:g} Pa is unlikely; check its unit."


def _ranges(material: str) -> PlausibleRanges:
    return plausible_ranges(material) or PlausibleRanges.model_validate({})


Ranges = Mapping[str, tuple[float, float]]


SHOWN: Mapping[str, tuple[str, float]] = {
    "temperature": ("K", 1.0),
    "initial grain size": ("µm", UNITS["length"]["um"]),
    "pressure": ("MPa", UNITS["stress"]["MPa"]),
    "water fugacity": ("MPa", UNITS["stress"]["MPa"]),
    "melt fraction": ("", 1.0),
    "period": ("s", 1.0),
    "strain rate": ("1/s", 1.0),
    "strain": ("%", UNITS["strain"]["percent"]),
    "stress": ("MPa", UNITS["stress"]["MPa"]),
}
"""Display unit of each condition, and its factor to SI."""


ENVIRONMENT_WORDS = tuple(name.replace("_", " ") for name in ENVIRONMENT)
"""Conditions that a test need not state."""

MECHANICAL = ("stress", "strain")
"""Conditions that tables of attenuation need not state."""

ROUNDING, TEMPERATURE_ROUNDING = 0.01, 0.001
"""Shares by which a condition, or a temperature, may lie outside a range and still count as inside:
a thousandth of a temperature is worth some three percent of a flow rate."""


def conditions(experiment: Experiment, predictions: xr.Dataset, parameters: xr.Dataset) -> Ranges:
    """Return the smallest and the largest value (SI) of every condition of a test.

    Strain and stress count from zero, like the strain rate by their size, in the median solution,
    and the stress in the readings too: a solution may be far from them. The strain is that of the
    material: its zero and the apparatus are no extrapolation.
    """
    found = {
        "temperature": temperature_range(experiment),
        "initial grain size": (experiment.initial_grain_size, experiment.initial_grain_size),
        **environment_ranges(experiment.environment),
    }
    if isinstance(experiment, AttenuationExperiment):
        period = experiment.conditions.period
        found["period"] = (float(period.min()), float(period.max()))
        if experiment.amplitude_is_stated:
            found["stress"] = (0.0, experiment.largest_stress)
        return found
    likelihood = likelihood_of(experiment)
    median: dict[str, FloatArray] = {}
    for column, (name, _) in likelihood.grid_quantities.items():
        solved = predictions[name].astype(np.float64)
        if name == "strain":
            solved = solved - _not_of_the_material(predictions, parameters)
        values = solved.median(("chain", "draw")).to_numpy()
        # An oscillating response without its trend stands for the whole one, too.
        median |= {column: values, f"grid_{name}": values}
    clock = likelihood.clock.name
    median[f"grid_{clock}"] = predictions[clock].to_numpy()
    solution = solution_columns(experiment, median)
    passed = np.diff(solution["time_s"])
    # The path strain is the material's alone, and has all digits beside any offset.
    strain = median.get("grid_path_strain", solution["strain"])
    rate = np.abs(np.diff(strain)[passed > 0] / passed[passed > 0])
    read = experiment.largest_stress if experiment.n_points else 0.0
    return {
        **found,
        "strain rate": (float(rate.min()), float(rate.max())),
        "strain": (0.0, float(np.abs(solution["strain"]).max())),
        "stress": (0.0, max(read, float(np.abs(solution["stress_Pa"]).max()))),
    }


def _not_of_the_material(predictions: xr.Dataset, parameters: xr.Dataset) -> xr.DataArray:
    """Part of a strain that is read off which is due to its zero and to the apparatus."""
    offset, compliance = (
        parameters.get(name, xr.DataArray(STANDARD_VALUES[name]))
        for name in ("strain_offset", "apparatus_compliance")
    )
    # By values: the labels of draws differ between groups.
    of_apparatus = compliance.drop_vars(compliance.coords) * predictions["stress"]
    return offset.drop_vars(offset.coords) + of_apparatus


def conditions_of(experiment: Experiment, posterior: xr.DataTree) -> Ranges:
    """Return the conditions that a fitted or predicted test passed."""
    groups = (posterior[name].to_dataset() for name in ("predictions", "posterior"))
    return conditions(experiment, *groups)


def outside(
    target: Ranges, fitted: Sequence[Ranges], acting: Sequence[str] = ENVIRONMENT
) -> tuple[str, ...]:
    """Say in which conditions a test leaves those that were fitted, a phrase for each.

    `acting`: those of `ENVIRONMENT` on which a rate depends; only of these a value is taken.
    """
    phrases, known = [], widest(fitted)
    for name, (low, high) in target.items():
        is_partly_unknown = name in ENVIRONMENT_WORDS and any(name not in one for one in fitted)
        if is_partly_unknown or (name in MECHANICAL and name not in known):
            phrases.append(f"{ranges_text({name: (low, high)})} (fitted: not stated)")
        elif name in known:
            (least, most), (unit, factor) = known[name], SHOWN[name]
            rounding = TEMPERATURE_ROUNDING if name == "temperature" else ROUNDING
            is_below = low < least * (1 - rounding)
            if is_below or high > most * (1 + rounding):
                there = f"{_range(low, high, factor, from_zero=is_below)} {unit}".rstrip()
                phrases.append(f"{name} {there} (fitted: {_range(least, most, factor)})")
    for key, name in zip(ENVIRONMENT, ENVIRONMENT_WORDS, strict=True):
        ends = [one[name] for one in fitted if name in one]
        taken = (STANDARD_VALUES[key],) * 2
        if key in acting and name not in target and any(end != taken for end in ends):
            unit, factor = SHOWN[name]
            there = f"{_range(*taken, factor)} {unit}".removeprefix("up to ").rstrip()
            here = _range(*known[name], factor)
            phrases.append(f"{name} not stated and taken as {there} (fitted: {here})")
    return tuple(phrases)


def beyond_sentences(
    target: Ranges, fitted: Sequence[Ranges], acting: Sequence[str] = ENVIRONMENT
) -> tuple[str, ...]:
    """Say in one sentence what `outside` finds; none where that is nothing."""
    beyond = outside(target, fitted, acting)
    return (f"Beyond what was fitted: {'; '.join(beyond)}.",) if beyond else ()


def longer_history(
    experiment: Experiment, fitted: Sequence[Experiment], passed: Sequence[Ranges]
) -> tuple[str, ...]:
    """Say whether a history lasts longer than all fitted tests and all periods of fitted tables."""
    periods = [one["period"][1] for one in passed if "period" in one]
    lasts, *others = (hours_of(one) * UNITS["time"]["h"] for one in (experiment, *fitted))
    longest = max([*others, *periods])
    if not isinstance(experiment, HistoryExperiment) or lasts <= longest * (1 + ROUNDING):
        return ()
    known = "period" if len(periods) == len(fitted) else "test"
    return (
        f"The test lasts {lasts:.4g} s, longer than any fitted {known} ({longest:.4g} s): slower "
        "delayed strain was not fitted.",
    )


def longer_than_tests(asked: Ranges, fitted: Sequence[Experiment]) -> tuple[str, ...]:
    """Say whether cycles last longer than all fitted tests, if none of those is a table."""
    longest = max(map(hours_of, fitted)) * UNITS["time"]["h"]
    lasts = asked.get("period", (0.0, 0.0))[1]
    if lasts <= longest or any(isinstance(one, AttenuationExperiment) for one in fitted):
        return ()
    return (
        f"Cycles of {lasts:.4g} s last longer than any fitted test ({longest:.4g} s): slower "
        "delayed strain was not fitted.",
    )


def doubtful_conditions(
    material: str, asked: Ranges, fitted: Sequence[Ranges], acting: Sequence[str] = ENVIRONMENT
) -> tuple[str, ...]:
    """Say which conditions were not fitted, or are unlikely in a material."""
    unlikely = [
        *(unlikely_temperature(material, *asked["temperature"]) if "temperature" in asked else ()),
        *(unlikely_stress(material, asked["stress"][1]) if "stress" in asked else ()),
    ]
    return (
        *beyond_sentences(asked, fitted, acting),
        *(f"{sentence[0].upper()}{sentence[1:]}" for sentence in unlikely),
    )


def widest(fitted: Sequence[Ranges]) -> Ranges:
    """Return the range of each condition over all tests that have it."""
    return {
        name: (min(low for low, _ in ends), max(high for _, high in ends))
        for name in dict.fromkeys(chain.from_iterable(fitted))
        if (ends := [one[name] for one in fitted if name in one])
    }


def ranges_text(ranges: Ranges) -> str:
    """Say in display units which conditions were passed."""
    return "; ".join(
        f"{name} {_range(*ends, SHOWN[name][1])} {SHOWN[name][0]}".rstrip()
        for name, ends in ranges.items()
    )


def environment_ranges(environment: Mapping[str, float]) -> Ranges:
    """Return the values of `ENVIRONMENT` (SI) that are known as conditions."""
    return {name.replace("_", " "): (value, value) for name, value in environment.items()}


def temperature_range(experiment: Experiment) -> tuple[float, float]:
    """Return the lowest and the highest temperature (K) of a test."""
    temperatures = experiment.temperatures
    return float(temperatures.min()), float(temperatures.max())


def hours_of(experiment: Experiment) -> float:
    """Return how long a test lasts (h), to four digits; 0 of a table, which does not say."""
    if isinstance(experiment, AttenuationExperiment):
        return 0.0
    ends = np.array(experiment.span)
    if isinstance(experiment, ConstantRateExperiment):
        ends = experiment.time_at(ends)
    return float(f"{np.ptp(ends) / UNITS['time']['h']:.4g}")


def _range(low: float, high: float, factor: float, *, from_zero: bool = False) -> str:
    """Return a range in a display unit; `from_zero` says that an end at zero is named."""
    low_text, high_text = (number(float(f"{end / factor:.4g}")) for end in (low, high))
    if low == 0 and not from_zero:
        return f"up to {high_text}"
    return low_text if low_text == high_text else f"{low_text} to {high_text}"
