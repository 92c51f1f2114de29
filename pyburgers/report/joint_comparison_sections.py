"""What several joint fits on one page say together: which predicts best, by points and by tests."""

from collections.abc import Sequence
from functools import partial

import pandas as pd

from pyburgers.comparison.by_tests import (
    BY_TEST_TEXT,
    ComparisonByTest,
    compare_kept_by_test,
    sentences_by_test,
    table_of_fits,
    table_of_tests,
)
from pyburgers.comparison.figures import LEFT_OUT_CAPTION, left_out_tests
from pyburgers.comparison.same_data import data_hash
from pyburgers.fitting.joint_fit import JointFit
from pyburgers.model.display import with_error
from pyburgers.report.joint_section import joint_names
from pyburgers.report.page import ExtraFigure, ExtraSection, ExtraTable, file_key
from pyburgers.report.same_data_sections import comparison_section


def related_joint_sections(joints: Sequence[JointFit]) -> tuple[ExtraSection, ...]:
    """Return the parts of a page about joint fits of the same tests.

    Parameters
    ----------
    joints : sequence of JointFit
        All joint fits of the page.

    Returns
    -------
    tuple of ExtraSection
        For tests with several joint fits a comparison by points; and one by tests where `pyburgers
        compare --leave-out tests` has left them out.
    """
    groups: dict[str, dict[str, JointFit]] = {}
    for name, joint in zip(joint_names(joints), joints, strict=True):
        if joint.manifest["use_likelihood"]:
            groups.setdefault(data_hash(joint), {})[name] = joint
    sections = []
    for group in groups.values():
        if len(group) > 1:
            sections.append(comparison_section(group))
        by_test = compare_kept_by_test(group)
        if by_test is not None:
            sections.append(left_out_section(next(iter(group)), by_test))
    return tuple(sections)


def left_out_section(first: str, comparison: ComparisonByTest) -> ExtraSection:
    """Return how well joint fits predict whole tests that they have not seen.

    Parameters
    ----------
    first : str
        Name of the first of them on the page.
    comparison : ComparisonByTest
        Their comparison.
    """
    fits, tests = table_of_fits(comparison), table_of_tests(comparison)
    return ExtraSection(
        key=f"left_out_{file_key(first)}",
        title=f"Whole tests left out: {first}",
        paragraphs=(BY_TEST_TEXT, *sentences_by_test(comparison)),
        tables=(
            ExtraTable(
                "fits",
                "All tests, the best fit first",
                _shown_fits(fits),
                fits.reset_index(),
                words=("fit", "variant"),
            ),
            ExtraTable(
                "tests",
                "Log density of each test given the others, ± Monte Carlo error",
                _shown_tests(tests, list(comparison.results)),
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


def _shown_fits(table: pd.DataFrame) -> pd.DataFrame:
    """Return `table_of_fits` as text."""
    columns = {
        "difference": "difference",
        "difference_se": "its standard error",
        "difference_monte_carlo_error": "its Monte Carlo error",
    }
    return pd.DataFrame(
        {
            "fit": table.index,
            "variant": table["variant"],
            "log density": [
                with_error(*row)
                for row in zip(table["elpd"], table["monte_carlo_error"], strict=True)
            ],
            **{shown: table[name].map("{:.1f}".format) for name, shown in columns.items()},
            "weight": table["weight"].map("{:.2f}".format),
        }
    )


def _shown_tests(table: pd.DataFrame, fits: Sequence[str]) -> pd.DataFrame:
    """Return `table_of_tests` as text."""
    return pd.DataFrame(
        {
            "test": table.index,
            "readings": table["points"].astype(str),
            **{
                name: [
                    with_error(*row)
                    for row in zip(
                        table[f"{name} elpd"], table[f"{name} monte_carlo_error"], strict=True
                    )
                ]
                for name in fits
            },
        }
    )
