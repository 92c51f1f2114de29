"""Parts of a page about fits of the same data: which predicts best, and sources of a flow law."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pyburgers.checks.prior_influence import read_off_sentences
from pyburgers.common.draws import FloatArray, all_draws, value_text
from pyburgers.common.paths import shown
from pyburgers.common.units import count_points, with_error
from pyburgers.comparison import conclusions, figures
from pyburgers.comparison.by_points import compare
from pyburgers.comparison.by_tests import compare_kept_by_test
from pyburgers.comparison.results import BY_TEST_TEXT, COMPARISON_TEXT, Comparison
from pyburgers.comparison.same_data import data_hash
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable, text_table
from pyburgers.drawing.panels import figure_of
from pyburgers.drawing.style import BLUE, GREEN, VERMILION, few_ticks
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.experiment import Experiment
from pyburgers.model.arrhenius import log_slowdown
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    axis_label,
    shown_quantity,
    unit_text,
)
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.priors import FLOW_LAW, JOINT_PRIOR
from pyburgers.page.names import file_key, page_keys, page_names

LOG_RATE = "log_flow_rate"
"""Row of the table of a flow law beside its parameters."""

DISAGREEMENT = 3.0
"""Joint standard deviations from which two sources of a flow law are said to disagree."""

SOURCE_COLOURS = (GREEN, BLUE, VERMILION)
SHOWN_SHARE = 0.995
"""Share of the draws of every source, by its ends, that a panel reaches to."""

BINS = 40

COMBINED_CAPTION = (
    "Distribution of each part of the flow law as the other source alone, the curve alone and both "
    "together have it. The last panel is the logarithm of the flow rate at the mean conditions of "
    "the other source, which it knows best."
)


def comparison_sections(fits: Sequence[Fit]) -> tuple[PageSection, ...]:
    """Return the parts of a page about fits of the same data, in the order of the fits.

    Parameters
    ----------
    fits : sequence of Fit
        All fits of the page, joint ones and their tests among them.

    Returns
    -------
    tuple of PageSection
        Comparisons by points, by whole tests, and of flow laws from another source.

    Examples
    --------
    >>> sections = pyburgers.comparison_sections([fit, other])
    """
    groups: dict[str, dict[str, Fit]] = {}
    names = page_names(fits)
    keys = dict(zip(names, map(file_key, page_keys(fits)), strict=True))
    for name, fit in zip(names, fits, strict=True):
        if fit.manifest["use_likelihood"]:
            groups.setdefault(data_hash(fit), {})[name] = fit
    return tuple(
        section
        for group in groups.values()
        for sections_about in (by_points_section, by_tests_section, flow_law_source_section)
        for section in sections_about(group, keys)
    )


def by_points_section(fits: Mapping[str, Fit], keys: Mapping[str, str]) -> tuple[PageSection, ...]:
    """Return the leave-one-out comparison of several fits of the same data, by their names."""
    if len(fits) < 2:
        return ()
    comparison = compare(fits)
    table = conclusions.comparison_table(comparison)
    said = conclusions.sentences(comparison)
    first = next(iter(fits))
    section = PageSection(
        key=f"comparison_{keys[first]}",
        title=f"Which fit of {first} predicts best",
        paragraphs=said,
        details=(COMPARISON_TEXT, *_points_to_fit_again(comparison, fits)),
        tables=(
            PageTable(
                "table",
                "Expected log predictive density, the best first",
                text_table(
                    table.reset_index(),
                    {
                        "fit": "{fit}",
                        "elpd": "{elpd:.1f}",
                        "difference": "{difference:.1f}",
                        "its standard error": "{difference_se:.1f}",
                        "weight": "{weight:.2f}",
                        "effective parameters": "{n_effective:.1f}",
                        "points with high k": "{high_k}",
                    },
                ),
                table.reset_index(),
                words=("fit",),
            ),
        ),
        figures=(
            PageFigure(
                "pointwise",
                "Where one fit predicts better than another",
                figures.COMPARISON_CAPTION,
                partial(figures.pointwise_differences, comparison),
                " ".join(said),
            ),
        ),
        after_fits=True,
    )
    return (section,)


def _points_to_fit_again(comparison: Comparison, fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """Say which command leaves points out in earnest, which a page never does."""
    count = sum(int(result.unreliable.sum()) for result in comparison.results.values())
    if not count or any(
        fit.is_joint or fit.is_part or fit.experiment.points_together for fit in fits.values()
    ):
        return ()
    runs = " ".join(shlex.quote(shown(fit.directory.path)) for fit in fits.values())
    return (f"To fit again without {count_points(count)} of that kind: pyburgers compare {runs}",)


def by_tests_section(joints: Mapping[str, Fit], keys: Mapping[str, str]) -> tuple[PageSection, ...]:
    """Return how well joint fits of the same data, by name, predict tests that were left out."""
    first, one = next(iter(joints.items()))
    comparison = compare_kept_by_test(joints) if one.is_joint else None
    if comparison is None:
        return ()
    said = conclusions.sentences_by_test(comparison)
    fits, tests = conclusions.table_of_fits(comparison), conclusions.table_of_tests(comparison)
    shown_fits = text_table(
        fits.reset_index(),
        {
            "fit": "{fit}",
            "variant": "{variant}",
            "difference": "{difference:.1f}",
            "its standard error": "{difference_se:.1f}",
            "its Monte Carlo error": "{difference_monte_carlo_error:.1f}",
            "weight": "{weight:.2f}",
        },
    )
    shown_fits.insert(2, "log density", _with_errors(fits["elpd"], fits["monte_carlo_error"]))
    shown_tests = text_table(tests.reset_index(), {"test": "{test}", "readings": "{points}"})
    for name in comparison.results:
        shown_tests[name] = _with_errors(tests[f"{name} elpd"], tests[f"{name} monte_carlo_error"])
    section = PageSection(
        key=f"left_out_{keys[first]}",
        title=f"Whole tests left out: {first}",
        paragraphs=said,
        details=(BY_TEST_TEXT,),
        tables=(
            PageTable(
                "fits",
                "All tests, the best fit first",
                shown_fits,
                fits.reset_index(),
                words=("fit", "variant"),
            ),
            PageTable(
                "tests",
                "Log density of each test given the others, ± Monte Carlo error",
                shown_tests,
                tests.reset_index(),
                words=("test",),
            ),
        ),
        figures=(
            PageFigure(
                "tests",
                "Which test a fit predicts better",
                figures.LEFT_OUT_CAPTION,
                partial(figures.left_out_tests, comparison),
                " ".join(said),
            ),
        ),
        after_fits=True,
    )
    return (section,)


def _with_errors(values: pd.Series, errors: pd.Series) -> list[str]:
    return [with_error(*pair) for pair in zip(values, errors, strict=True)]


def flow_law_source_section(
    fits: Mapping[str, Fit], keys: Mapping[str, str]
) -> tuple[PageSection, ...]:
    """Compare the first two fits of equal laws with and without a joint prior of the flow law."""
    pair = next(_pairs_by_source(fits), None)
    if pair is None:
        return ()
    alone, both, law = pair
    draws = _flow_law_draws(law, fits[alone], fits[both])
    table = flow_law_sources_table(draws)
    experiment, at = fits[alone].experiment, law.conditions
    rate = (
        f"the flow rate at {at.temperature:.1f} K, {at.stress * STRESS_FACTOR:.2f} {STRESS_UNIT} "
        f"and {at.grain_size * LENGTH_FACTOR:.0f} {LENGTH_UNIT}"
    )
    synthetic = (
        f"{experiment.id} is synthetic: that it is combined with other data shows the method and "
        "says nothing about nature.",
    )
    said = read_off_sentences(fits[both].read_off & {JOINT_PRIOR}) or (
        _agreement(draws["other source alone"][LOG_RATE], draws["curve alone"][LOG_RATE]),
    )
    section = PageSection(
        key=f"flow_law_{keys[both]}",
        title=f"Flow law of {alone}, with another source and without",
        paragraphs=(*said, *(synthetic if experiment.provenance.kind == "synthetic" else ())),
        details=(
            f"The other source is {law.source}. {alone} is the fit of the curve alone with the "
            f"material's own priors; {both} has the other source as a joint prior of n, p, "
            f"{rate}, and beta in their place.",
            "Mean ± standard deviation. If both together are wider than the curve alone, the "
            "curve's number came from its own prior, which the other source replaces.",
            _temperature_correction(law, experiment, draws["other source alone"]),
        ),
        tables=(
            PageTable(
                "sources",
                "Flow law by source, in numbers",
                _shown_sources(table),
                table.reset_index(),
                words=("quantity", "unit"),
            ),
        ),
        figures=(
            PageFigure(
                "sources",
                "Flow law by source",
                COMBINED_CAPTION,
                partial(combined_flow_law, draws),
                " ".join(said),
            ),
        ),
        after_fits=True,
    )
    return (section,)


def _pairs_by_source(fits: Mapping[str, Fit]) -> Iterator[tuple[str, str, FlowLawPrior]]:
    """Yield names of two fits of equal laws, without a joint prior and with it, and that prior.

    They flow by a power law alone, whose parameters are free: its rate is that of the prior.
    """
    able = {
        name: fit
        for name, fit in fits.items()
        if not fit.is_joint
        and fit.variant.maxwell == "power_law"
        and fit.variant.hardening == fit.variant.second_mechanism == "none"
        and not any(fit.priors[parameter].is_fixed for parameter in FLOW_LAW)
    }
    for both, other in able.items():
        for alone, fit in able.items():
            law = other.priors.flow_law
            if law and not fit.priors.flow_law and fit.variant == other.variant:
                yield alone, both, law


def _flow_law_draws(law: FlowLawPrior, alone: Fit, both: Fit) -> dict[str, dict[str, FloatArray]]:
    """Return draws (SI) of the flow law by source and quantity."""
    found = {}
    for name, fit in (("curve alone", alone), ("both", both)):
        dataset = fit.posterior["posterior"].to_dataset()
        found[name] = {quantity: all_draws(dataset[quantity]) for quantity in FLOW_LAW}
    rng = np.random.default_rng(1)
    n_draws = found["both"][FLOW_LAW[0]].size
    drawn = [law.sample(rng) for _ in range(n_draws)]
    other = {name: np.array([draw[name] for draw in drawn]) for name in FLOW_LAW}
    by_source = {"other source alone": other, **found}
    return {
        name: {**values, LOG_RATE: law.log_flow_rate(values)} for name, values in by_source.items()
    }


def _agreement(other: FloatArray, alone: FloatArray) -> str:
    """Say how far draws of two sources are from each other."""
    distance = abs(np.mean(alone) - np.mean(other)) / np.hypot(np.std(alone), np.std(other))
    apart = f"they are {distance:.1f} of their joint standard deviations apart"
    if distance < DISAGREEMENT:
        return f"The two sources agree on the flow rate: {apart}."
    return (
        f"The two sources disagree on the flow rate: {apart}, so that both together bend other "
        "parameters of the curve."
    )


def _temperature_correction(
    law: FlowLawPrior, experiment: Experiment, draws: Mapping[str, FloatArray]
) -> str:
    """State by how much the rate of another source changes up to the temperature of a test."""
    change = log_slowdown(
        draws["activation_enthalpy"], law.conditions.temperature, experiment.temperature
    )
    return (
        f"The other source's flow rate holds at {law.conditions.temperature:.1f} K, "
        f"{experiment.id} was at {experiment.temperature:.1f} K: its activation enthalpy changes "
        f"ln(flow rate) by {value_text(change)} up to there."
    )


def flow_law_sources_table(draws: Mapping[str, Mapping[str, FloatArray]]) -> pd.DataFrame:
    """Return mean and sd (SI) of draws: rows quantities, columns ``SOURCE mean``, ``SOURCE sd``."""
    quantities = next(iter(draws.values()))
    rows = {
        quantity: {
            f"{source} {name}": float(moment(values[quantity]))
            for source, values in draws.items()
            for name, moment in (("mean", np.mean), ("sd", partial(np.std, ddof=1)))
        }
        for quantity in quantities
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("quantity")


def _shown_sources(table: pd.DataFrame) -> pd.DataFrame:
    """Return `flow_law_sources_table` as text in display units."""
    columns = [str(column) for column in table]
    sources = [column.removesuffix(" mean") for column in columns if column.endswith(" mean")]
    rows = []
    for name, row in table.iterrows():
        label, unit, factor = "ln(flow rate)", "–", 1.0
        if name != LOG_RATE:
            quantity = shown_quantity(str(name))
            label, unit, factor = quantity.label, unit_text(quantity), quantity.display_factor
        shown = {}
        for source in sources:
            mean, sd = (row[f"{source} {key}"] * factor for key in ("mean", "sd"))
            shown[source] = with_error(mean, sd)
        share = row["both sd"] / row["curve alone sd"]
        rows.append(
            {"quantity": label, "unit": unit, **shown, "sd both / curve alone": f"{share:.2f}"}
        )
    return pd.DataFrame(rows)


def combined_flow_law(draws: Mapping[str, Mapping[str, FloatArray]]) -> Figure:
    """Draw distributions of n, p, Q_M and ln(flow rate s), the last quantity, by source (SI)."""
    *parameters, log_rate = (name for name in next(iter(draws.values())) if name != "beta")
    with figure_of(9.0, 2.8) as figure:
        panels = figure.subplots(1, len(parameters) + 1)
        for axes, name in zip(panels, [*parameters, log_rate], strict=True):
            factor = 1.0 if name == log_rate else shown_quantity(name).display_factor
            shown = {source: values[name] * factor for source, values in draws.items()}
            low = min(float(np.quantile(v, 1 - SHOWN_SHARE)) for v in shown.values())
            high = max(float(np.quantile(v, SHOWN_SHARE)) for v in shown.values())
            for (source, values), colour in zip(shown.items(), SOURCE_COLOURS, strict=True):
                axes.hist(
                    values,
                    bins=BINS,
                    range=(low, high),
                    density=True,
                    histtype="step",
                    linewidth=1.4,
                    color=colour,
                    label=source,
                )
            axes.set_xlabel(
                "ln(flow rate · s)" if name == log_rate else axis_label(shown_quantity(name))
            )
            axes.set_yticks([])
            axes.spines["left"].set_visible(False)
            axes.xaxis.set_major_locator(few_ticks(4))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure
