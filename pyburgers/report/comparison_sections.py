"""Parts of a page about several fits of the same data: which predicts best.

By points, by whole tests left out, and with a flow law from another source and without.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TypeVar

import pandas as pd

from pyburgers.common.numbers import with_error
from pyburgers.comparison.by_points import (
    COMPARISON_TEXT,
    compare,
    comparison_table,
    sentences,
)
from pyburgers.comparison.by_tests import (
    BY_TEST_TEXT,
    ComparisonByTest,
    compare_kept_by_test,
    sentences_by_test,
    table_of_fits,
    table_of_tests,
)
from pyburgers.comparison.figures import (
    COMPARISON_CAPTION,
    LEFT_OUT_CAPTION,
    left_out_tests,
    pointwise_differences,
)
from pyburgers.comparison.same_data import data_hash
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.joint_fit import JointFit
from pyburgers.report.flow_law_sections import flow_law_source_section
from pyburgers.report.joint_section import joint_names
from pyburgers.report.page import ExtraFigure, ExtraSection, ExtraTable, file_key, page_keys

AnyFit = TypeVar("AnyFit", Fit, JointFit)


def comparison_sections(
    fits: Sequence[Fit], joints: Sequence[JointFit] = ()
) -> tuple[ExtraSection, ...]:
    """Return the parts of a page about fits of the same data, joint fits first.

    Parameters
    ----------
    fits : sequence of Fit
        All fits of single tests on the page.
    joints : sequence of JointFit
        All joint fits of the page.

    Returns
    -------
    tuple of ExtraSection
        A comparison by points for each data set with several fits; one by tests where `pyburgers
        compare --leave-out tests` has left them out of joint fits; and one of flow laws where a
        fit takes its own from another source and another does not.
    """
    sections = []
    for joint_group in _same_data(zip(joint_names(joints), joints, strict=True)):
        if len(joint_group) > 1:
            sections.append(by_points_section(joint_group))
        by_test = compare_kept_by_test(joint_group)
        if by_test is not None:
            sections.append(by_tests_section(next(iter(joint_group)), by_test))
    for group in _same_data(zip(page_keys(fits), fits, strict=True)):
        if len(group) > 1:
            sections += [by_points_section(group), *flow_law_source_section(group)]
    return tuple(sections)


def _same_data(named: Iterable[tuple[str, AnyFit]]) -> list[dict[str, AnyFit]]:
    """Gather fits with a likelihood by the data that they are of."""
    groups: dict[str, dict[str, AnyFit]] = {}
    for name, fit in named:
        if fit.manifest["use_likelihood"]:
            groups.setdefault(data_hash(fit), {})[name] = fit
    return list(groups.values())


def by_points_section(fits: Mapping[str, Fit] | Mapping[str, JointFit]) -> ExtraSection:
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
                _shown(
                    table,
                    {
                        "elpd": ("elpd", "{:.1f}"),
                        "difference": ("difference", "{:.1f}"),
                        "its standard error": ("difference_se", "{:.1f}"),
                        "weight": ("weight", "{:.2f}"),
                        "effective parameters": ("n_effective", "{:.1f}"),
                        "points with high k": ("high_k", "{}"),
                    },
                ),
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


def by_tests_section(first: str, comparison: ComparisonByTest) -> ExtraSection:
    """Return how well joint fits predict whole tests that they have not seen.

    Parameters
    ----------
    first : str
        Name of the first of them on the page.
    comparison : ComparisonByTest
        Their comparison.
    """
    fits, tests = table_of_fits(comparison), table_of_tests(comparison)
    shown_fits = _shown(
        fits,
        {
            "variant": ("variant", "{}"),
            "difference": ("difference", "{:.1f}"),
            "its standard error": ("difference_se", "{:.1f}"),
            "its Monte Carlo error": ("difference_monte_carlo_error", "{:.1f}"),
            "weight": ("weight", "{:.2f}"),
        },
    )
    shown_fits.insert(2, "log density", _with_errors(fits["elpd"], fits["monte_carlo_error"]))
    shown_tests = _shown(tests, {"readings": ("points", "{}")})
    for name in comparison.results:
        shown_tests[name] = _with_errors(tests[f"{name} elpd"], tests[f"{name} monte_carlo_error"])
    return ExtraSection(
        key=f"left_out_{file_key(first)}",
        title=f"Whole tests left out: {first}",
        paragraphs=(BY_TEST_TEXT, *sentences_by_test(comparison)),
        tables=(
            ExtraTable(
                "fits",
                "All tests, the best fit first",
                shown_fits,
                fits.reset_index(),
                words=("fit", "variant"),
            ),
            ExtraTable(
                "tests",
                "Log density of each test given the others, ± Monte Carlo error",
                shown_tests,
                tests.reset_index(),
                words=("test",),
            ),
        ),
        figures=(
            ExtraFigure(
                "tests",
                "Which test a fit predicts better",
                LEFT_OUT_CAPTION,
                partial(left_out_tests, comparison),
            ),
        ),
        after_fits=True,
    )


def _shown(table: pd.DataFrame, columns: Mapping[str, tuple[str, str]]) -> pd.DataFrame:
    """Return a table as text: its index, then columns by heading, each with its format."""
    shown = {heading: table[name].map(form.format) for heading, (name, form) in columns.items()}
    return pd.DataFrame(shown).reset_index()


def _with_errors(values: pd.Series, errors: pd.Series) -> list[str]:
    return [with_error(*pair) for pair in zip(values, errors, strict=True)]
