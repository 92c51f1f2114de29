"""What a page calls its fits."""

from pathlib import Path

import pytest
from synthetic_fit import make_fit

from pyburgers.common.errors import InputError
from pyburgers.page.names import file_key, joint_key, page_keys, page_names


def test_fits_are_called_after_their_folders(tmp_path: Path) -> None:
    fits = [
        make_fit(tmp_path / folder, chains=1, draws=20) for folder in ("warm", "x/cold", "y/cold")
    ]
    assert page_keys(fits[:2]) == ["warm", "cold"]
    assert page_keys(fits[1:]) == ["x_cold", "y_cold"]
    with pytest.raises(InputError, match="warm: found this run twice"):
        page_keys([fits[0], fits[0]])


def test_a_page_calls_fits_by_words(tmp_path: Path) -> None:
    folders = {
        "dunite_4581": "dunite 4581",
        "dunite_4581_kelvin_power_law": "dunite 4581, kelvin power law",
        "of_another_test": "of another test",
    }
    fits = [
        make_fit(tmp_path / folder, name="dunite_4581", chains=1, draws=20) for folder in folders
    ]
    assert page_names(fits) == list(folders.values())
    # Two folders that would be called alike keep their own names.
    alike = make_fit(tmp_path / "dunite 4581", name="dunite_4581", chains=1, draws=20)
    assert page_names([alike, *fits])[:2] == ["dunite 4581", "dunite_4581"]


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "a b", "<b>", '"', "a/b", "..", ".hidden", "ä", "x\ny", ""]
)
def test_names_cannot_leave_their_folder_nor_meet(name: str, tmp_path: Path) -> None:
    key = file_key(name)
    file = tmp_path / f"{key}_summary.csv"
    assert file.resolve().parent == tmp_path
    assert not key.startswith(".")
    assert not set(key) & set("/\\ \"'<>&#%\n")
    assert key == file_key(name)
    assert key != file_key(f"{name}_")


def test_simple_names_stay_as_they_are() -> None:
    assert file_key("dunite_4581+x") == "dunite_4581+x"
    assert file_key("joint: test") == "joint.test"
    assert joint_key("both") == "joint_both"
    assert file_key("a b") != file_key("a_b")
