"""A joint fit far from the fit of a test alone is told."""

import numpy as np
import pandas as pd

from pyburgers.page.joint_section import strayed


def pooling(joint: float, alone: float, sd: float) -> pd.DataFrame:
    """Two tests: the second, whose reference stress is `joint` and `alone`, has a fit alone."""
    return pd.DataFrame(
        {
            "quantity": ["stress_exponent", "reference_stress", "reference_stress"],
            "test": ["A", "A", "B"],
            "mean": [3.5, 200e6, joint],
            "sd": [0.1, 4e6, 4e6],
            "separate_mean": [3.6, np.nan, alone],
            "separate_sd": [0.2, np.nan, sd],
        }
    )


def test_the_reference_stress_of_a_joint_fit_far_from_that_of_the_test_alone_is_told() -> None:
    told = strayed(pooling(406e6, 380e6, 10e6))
    assert told is not None
    assert "reference stress of B (+2.6 sd)" in told
    assert "of A" not in told
    assert "the tests do not agree on what they share" in told


def test_a_joint_fit_near_that_of_each_test_alone_needs_no_words() -> None:
    assert strayed(pooling(390e6, 380e6, 10e6)) is None
