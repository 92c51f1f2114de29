"""What several runs on one page say together: which predicts best, what another source adds."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.comparison.by_points import (
    COMPARISON_TEXT,
    Comparison,
    compare,
    comparison_table,
    sentences,
)
from pyburgers.comparison.figures import COMPARISON_CAPTION, pointwise_differences
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
    unit_text,
    with_error,
)
from pyburgers.common.draws import all_draws
from pyburgers.fitting.fit import Fit
from pyburgers.report.flow_law_figures import COMBINED_CAPTION, combined_flow_law
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.fitting.joint_fit import JointFit
from pyburgers.model.priors import FLOW_LAW
from pyburgers.report.page import ExtraFigure, ExtraSection, ExtraTable, file_key, page_keys
from pyburgers.comparison.same_data import data_hash

FloatArray = npt.NDArray[np.float64]

LOG_RATE = "log_flow_rate"
"""Row of the table of a flow law beside its parameters."""

DISAGREEMENT = 3.0
"""Joint standard deviations from which two sources of a flow law are said to disagree."""


def related_sections(fits: Sequence[Fit]) -> tuple[ExtraSection, ...]:
    """Return the parts of a page about runs of the same data, in the order of the fits.

    Parameters
    ----------
    fits : sequence of Fit
        All fits of the page.

    Returns
    -------
    tuple of ExtraSection
        A comparison for each data set with several fits, and one more where a fit of it takes its
        flow law from another source and another does not.
    """
    groups: dict[str, dict[str, Fit]] = {}
    for key, fit in zip(page_keys(fits), fits, strict=True):
        if fit.manifest["use_likelihood"]:
            groups.setdefault(data_hash(fit), {})[key] = fit
    sections = []
    for group in groups.values():
        if len(group) < 2:
            continue
        sections.append(comparison_section(group))
        alone = [key for key, fit in group.items() if fit.priors.flow_law is None]
        both = [key for key, fit in group.items() if fit.priors.flow_law is not None]
        if alone and both:
            sections.append(
                combined_section((alone[0], group[alone[0]]), (both[0], group[both[0]]))
            )
    return tuple(sections)


def comparison_section(fits: Mapping[str, Fit] | Mapping[str, JointFit]) -> ExtraSection:
    """Return the leave-one-out comparison of fits of the same data.

    Parameters
    ----------
    fits : mapping of str to Fit or JointFit
        At least two, by their names on the page.
    """
    comparison = compare(fits)
    table = comparison_table(comparison)
    first = next(iter(fits))
    return ExtraSection(
        key=f"comparison_{file_key(first)}",
        title=f"Which fit of {first} predicts best",
        paragraphs=(COMPARISON_TEXT, *sentences(comparison)),
        tables=(
            ExtraTable(
                "table",
                "Expected log predictive density, the best first",
                _shown_comparison(comparison),
                table.reset_index(),
                words=("fit",),
            ),
        ),
        figures=(
            ExtraFigure(
                "pointwise",
                "Where one fit predicts better than another",
                COMPARISON_CAPTION,
                partial(pointwise_differences, comparison),
            ),
        ),
        after_fits=True,
    )


def _shown_comparison(comparison: Comparison) -> pd.DataFrame:
    """Return the table of a comparison as text."""
    table = comparison_table(comparison)
    return pd.DataFrame(
        {
            "fit": table.index,
            "elpd": table["elpd"].map("{:.1f}".format),
            "difference": table["difference"].map("{:.1f}".format),
            "its standard error": table["difference_se"].map("{:.1f}".format),
            "weight": table["weight"].map("{:.2f}".format),
            "effective parameters": table["n_effective"].map("{:.1f}".format),
            "points with high k": table["high_k"].astype(str),
        }
    )


def combined_section(alone: tuple[str, Fit], both: tuple[str, Fit]) -> ExtraSection:
    """Return what a flow law from another source adds to a curve.

    Parameters
    ----------
    alone, both : tuple of str and Fit
        Fits of the same data by their names on the page, without and with a joint prior of the
        flow law.
    """
    law = both[1].priors.flow_law
    assert law is not None  # which is what tells the two apart
    draws = _flow_law_draws(law, alone[1], both[1])
    table = flow_law_sources_table(draws)
    experiment, at = alone[1].experiment, law.conditions
    rate = (
        f"the flow rate at {at.temperature:.1f} K, {at.stress * STRESS_FACTOR:.2f} {STRESS_UNIT} "
        f"and {at.grain_size * LENGTH_FACTOR:.0f} {LENGTH_UNIT}"
    )
    synthetic = (
        f"{experiment.id} is synthetic: that it is combined with other data shows the method and "
        "says nothing about nature.",
    )
    return ExtraSection(
        key=f"flow_law_{both[0]}",
        title=f"Flow law of {alone[0]}, with another source and without",
        paragraphs=(
            f"The other source is {law.source}. {alone[0]} is the fit of the curve alone with the "
            f"material's own priors; {both[0]} has the other source as a joint prior of n, p, "
            f"{rate}, and beta in their place.",
            "Mean ± standard deviation. Where both together are wider than the curve alone, the "
            "curve's number was that of its own prior, which the other source replaces.",
            _agreement(draws["other source alone"][LOG_RATE], draws["curve alone"][LOG_RATE]),
            *(synthetic if experiment.provenance.kind == "synthetic" else ()),
        ),
        tables=(
            ExtraTable(
                "sources",
                "What each source knows",
                _shown_sources(table),
                table.reset_index(),
                words=("quantity", "unit"),
            ),
        ),
        figures=(
            ExtraFigure(
                "sources",
                "Flow law by source",
                COMBINED_CAPTION,
                partial(combined_flow_law, draws),
            ),
        ),
        after_fits=True,
    )


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
    if distance < DISAGREEMENT:
        return (
            f"The two sources agree on the flow rate: they are {distance:.1f} of their joint "
            "standard deviations apart."
        )
    return (
        f"The two sources disagree on the flow rate: they are {distance:.1f} of their joint "
        "standard deviations apart, so that both together bend other parameters of the curve."
    )


def flow_law_sources_table(draws: Mapping[str, Mapping[str, FloatArray]]) -> pd.DataFrame:
    """Mean and standard deviation (SI) of each quantity by source.

    Parameters
    ----------
    draws : mapping
        By source and quantity.

    Returns
    -------
    DataFrame
        Index quantity; columns ``SOURCE mean`` and ``SOURCE sd``.
    """
    quantities = next(iter(draws.values()))
    rows = {
        quantity: {
            f"{source} {name}": float(number)
            for source, values in draws.items()
            for name, number in (
                ("mean", np.mean(values[quantity])),
                ("sd", np.std(values[quantity], ddof=1)),
            )
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
