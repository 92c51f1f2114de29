"""What a page tells of the runs behind it."""

from pathlib import Path

import pytest
from synthetic_fit import make_fit

from pyburgers.common.units import duration_text
from pyburgers.page.run_records import runs_table


def test_a_run_has_its_state_its_hash_and_the_time_of_all_chains(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50)
    (row,) = runs_table([("A", fit)]).to_dict("records")
    assert row["fit"] == "A"
    assert row["state"] == fit.manifest["status"]
    assert row["fingerprint"] == fit.manifest["fingerprint"]
    assert row["all chains"] == "2 min"


@pytest.mark.parametrize(
    ("seconds", "expected"), [(5.2, "5 s"), (600.0, "10 min"), (9000.0, "2.5 h")]
)
def test_durations(seconds: float, expected: str) -> None:
    assert duration_text(seconds) == expected
