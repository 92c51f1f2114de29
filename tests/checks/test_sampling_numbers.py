"""A number beyond its limit never reads as if it were at it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyburgers.checks.fit_checks import ESS_LIMIT, RHAT_LIMIT, beyond


@given(st.floats(min_value=1e-9, max_value=0.1))
def test_a_number_beyond_its_limit_is_printed_beyond_it(excess: float) -> None:
    assert float(beyond(RHAT_LIMIT + excess, 3, above=True)) > RHAT_LIMIT
    assert float(beyond(ESS_LIMIT - 1000 * excess, 0, above=False)) < ESS_LIMIT


@pytest.mark.parametrize(
    ("value", "digits", "above", "text"),
    [(1.0102, 3, True, "1.011"), (399.7, 0, False, "399"), (float("nan"), 3, True, "nan")],
)
def test_numbers_are_rounded_away_from_their_limit(
    value: float, digits: int, above: bool, text: str
) -> None:
    assert beyond(value, digits, above=above) == text
