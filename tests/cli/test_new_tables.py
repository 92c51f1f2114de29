"""`pyburgers new` of tables whose numbers, and what they do, are easily taken for others."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pyburgers.cli.main import main

KNOWN = ("--material", "ice", "--grain-size-m", "1e-3")
AT_263 = (*KNOWN, "--temperature-K", "263")
RATE = ("--strain-rate-per-s", "1e-5")


def written(folder: Path, head: str, rows: Sequence[str] | np.ndarray, sign: str = ",") -> Path:
    """Write a table; rows are texts or numbers."""
    lines = [one if isinstance(one, str) else sign.join(f"{x:.8g}" for x in one) for one in rows]
    path = folder / "table.csv"
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return path


def test_points_that_separate_thousands_beside_decimal_commas_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ["10;0,1;936", "20;0,2;991", "30;0,3;1.039", "1.040;0,4;1.103.000"]
    path = written(tmp_path, "Zeit [s];Dehnung [%];Spannung [MPa]", rows)
    assert main(["new", str(path), *AT_263, *RATE]) == 2
    errors = [one for one in capsys.readouterr().out.splitlines() if one.startswith("error: ")]
    assert len(errors) == 1
    assert "line 4: found '1.039' (and in 1 more lines) beside decimal commas" in errors[0]
    path.write_text(path.read_text("utf-8").replace(".", ""), encoding="utf-8")
    assert main(["check-file", str(path.with_suffix(".toml"))]) == 0


def test_commas_between_thousands_are_to_be_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, "Strain (%);Stress (MPa)", ["0.1;991", "0.2;1,039", "0.3;1,103"])
    assert main(["new", str(path), *AT_263, *RATE]) == 2
    assert "remove a comma between thousands" in capsys.readouterr().out


STRAIN = np.linspace(0, 0.08, 161)
CURVE = 300 * (1 - np.exp(-np.maximum(STRAIN - 0.02, 0) / 0.003))


@pytest.mark.parametrize(
    "stress", [20 + CURVE, CURVE * np.minimum(STRAIN / 0.03, 1) ** 2], ids=["friction", "slack"]
)
def test_slack_and_friction_at_one_rate_are_no_steps_of_a_load(
    stress: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = np.column_stack([STRAIN / 1e-5, 100 * STRAIN, stress])
    path = written(tmp_path, "Time (s),Strain (%),Stress (MPa)", rows)
    assert main(["new", str(path), *AT_263]) == 0
    assert "protocol constant_rate" in capsys.readouterr().out
