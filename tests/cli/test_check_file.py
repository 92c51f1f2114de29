"""`pyburgers check-file` of shipped files, and of tables; tests/messages has what it says."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from refusals import CommandLine
from small_inputs import CURVE, DATA

from pyburgers.cli.unread_columns import unread_note
from pyburgers.common.text_tables import look_at


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(DATA.rglob("*.toml")) if path.parent.name != "variants"],
    ids=lambda path: path.stem,
)
def test_shipped_files_have_no_errors(path: Path, cli: CommandLine) -> None:
    out = cli("check-file", path)
    assert "no errors" in out
    assert "error: " not in out
    assert "hint: " not in out


@pytest.mark.parametrize("content", [CURVE.encode(), CURVE.encode("utf-16"), b"PK\x03\x04\xff"])
def test_a_table_in_the_place_of_an_experiment_file(
    content: bytes, tmp_path: Path, cli: CommandLine
) -> None:
    path = tmp_path / "my curve.csv"
    path.write_bytes(content)
    cli("fit", path, code=2)
    assert f"write an experiment file for them: pyburgers new '{path}'." in cli.error


Column = tuple[str, str | None, str]
"""Name, unit and number in each row."""

KINDS: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Column]]] = {
    "rates": (
        {"tests": [{"imposed": "stress", "regime": "minimum", "geometry": "compression"}]},
        {
            "temperature": ("T (C)", "C", "-10"),
            "stress": ("stress (MPa)", "MPa", "1"),
            "strain_rate": ("rate (1/s)", "1/s", "0.1"),
            "grain_size": ("d (mm)", "mm", "0.5"),
        },
    ),
    "constant_rate": (
        {"segments": [{"start_strain": 0.0, "strain_rate_per_s": 1e-5}]},
        {"strain": ("Strain (%)", "percent", "2"), "stress": ("Stress (MPa)", "MPa", "3")},
    ),
    "loading_history": (
        {
            "stages": [{"control": "stress", "start_time": 0, "end_time": 9, "stress": 1e6}],
            "strain_measure": "engineering",
        },
        {"time": ("t (s)", "s", "5"), "strain": ("Strain (%)", "percent", "2")},
    ),
    "attenuation": (
        {"attenuation": {"deformation": "shear", "poisson_ratio": 0.25}},
        {
            "period": ("Period (s)", "s", "10"),
            "modulus": ("G (GPa)", "GPa", "60"),
            "attenuation": ("1/Q", None, "0.1"),
        },
    ),
}
"""Keys of a file of a kind of test, and its columns."""


def checked(folder: Path, protocol: str, columns: Mapping[str, Column], beside: str) -> Path:
    """Write a table of rows alike, and a file that reads all columns but the one `beside` them."""
    keys, own = KINDS[protocol]
    columns = {**own, **columns}
    data: dict[str, str] = {"file": "table.csv"}
    for quantity, (name, unit, _) in columns.items():
        data[f"{quantity}_column"] = name
        if unit is not None:
            data[f"{quantity}_unit"] = unit
    if protocol == "attenuation":
        data["attenuation_form"] = "tan_delta"
    names, numbers = [one[0] for one in columns.values()], [one[2] for one in columns.values()]
    if beside:
        name, _, number = beside.partition(" = ")
        names, numbers = [*names, name], [*numbers, number]
    n_rows = 1 if protocol == "attenuation" else 3  # each period once
    rows = [",".join(names), *[",".join(numbers)] * n_rows]
    (folder / "table.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    content = {
        "id": "x",
        "material": "ice",
        "protocol": protocol,
        **({} if protocol == "rates" else {"temperature_K": 263.0, "initial_grain_size_m": 1e-3}),
        **keys,
        "data": data,
        "provenance": {"kind": "measured", "source": "s"},
    }
    path = folder / "test.toml"
    path.write_text(tomli_w.dumps(content), encoding="utf-8")
    return path


OTHER_NAMES: Mapping[tuple[str, str, str | None], str] = {
    ("rates", "strain_rate", "1/s"): """
        Rate (1e-6/s) = 0.1: the unit '1e-6/s': check it
        -log10 rate (1/s) = 7: 7 1/s is unlikely
        -log10 rate (1/s) = 0.1: a factor, or a logarithm
        strain_rate_per_year = 1e-7: another unit
        shear rate (1/s) = 1e-7: check the keys geometry and
        strain = 0.1: its name is that of the strain
        viscosity (Pa s) = 0.1: that of another quantity
        rate error (1/s) = 0.1: its name is that of an error
        eps_dot = 1e-6
        strain_per_s = 1e-6
        Verformungsrate = 1e-6""",
    ("rates", "strain_rate", "1e-6/s"): "Rate (1e-6/s) = 0.1",
    ("rates", "stress", "MPa"): """
        Shear stress (MPa) = 1: check the keys geometry and
        Pc (MPa) = 1: name is that of another quantity""",
    ("rates", "pressure", "MPa"): "Confining pressure (MPa) = 50",
    ("rates", "grain_size", "mm"): """
        grain size (um) = 0.5: the unit 'um': check it
        grain_size_cm = 0.5: another unit
        rate_per_s = 0.5: its name is that of a rate""",
    ("rates", "grain_size", "um"): """
        grain radius (um) = 500: that of another quantity
        mean d = 500""",
    ("rates", "water_fugacity", "GPa"): "fH2O (MPa) = 10: the unit 'MPa': check it",
    ("rates", "reading_error", "1"): """
        reading error (%) = 0.2: the unit 'percent': check
        sd rate (1/s) = 1e-8: in the unit of a rate
        rel. sd of the rate = 0.05""",
    ("rates", "reading_error", "percent"): "rel. error (%) = 5",
    ("constant_rate", "strain", "percent"): """
        Lateral strain (%) = 2: of another quantity
        Shear strain (%) = 2: of shear: write sqrt(3) tau as the stress, gamma/sqrt(3) as
        Twist strain (%) = 2: of torsion: a torque M gives tau = (3 + 1/n) M/(2 pi R^3)
        Mises strain of gamma (%) = 2
        Strain err (%) = 2: its name is that of an error
        Creep strain (%) = 2: taken as the total strain
        dL/L0 strain (%) = 2: taken as true strain, though""",
    ("constant_rate", "stress", "MPa"): """
        Nennspannung [MPa] = 2: taken as true stress, though
        Stress amplitude (MPa) = 2: that of the amplitude
        Tensile stress (MPa) = 3
        Load (MPa) = 3""",
    ("loading_history", "strain", "percent"): """
        Elongation (%) = 2: that of tension: write compression = "negative"
        Elongation (%) = -2: are negative, but compression is positive in this model
        Zugdehnung (%) = 2: that of tension: write compression = "negative"
        Extensometer strain (%) = 2
        Bezug der Dehnung (%) = 2""",
    ("attenuation", "modulus", "GPa"): """
        E' (GPa) = 60: that of the storage modulus
        Youngs modulus (GPa) = 60: states axial: check it
        Shear modulus = 60""",
    ("attenuation", "attenuation", None): """
        log 1/Q = 0.1: whose name says a logarithm
        log decrement = 0.1: a logarithmic decrement: divide it by pi
        dW/W = 0.1: divide it by 2 pi
        Specific damping capacity = 0.1: divide it by 2 pi
        sin delta = 0.1: write tan(arcsin(...)) of it
        FWHM = 0.1: divide it by the frequency, and by sqrt(3) if
        tan delta f = 1 Hz = 0.1
        Q = 0.1: a quality factor: write 1/Q
        inverse quality factor = 0.1: another unit""",
    ("attenuation", "attenuation_uncertainty", None): """
        err 1/Q (%) = 5: another unit
        sd of 1/Q = 0.01""",
    ("attenuation", "limit", None): "log10 limit = 0.01",
    ("attenuation", "temperature", "K"): "T = 263",
}
"""By kind, quantity and unit: names of its column, a number, and what is said of the name."""

NAMED = [
    (protocol, {quantity: (column[0], unit, column[1])}, said)
    for (protocol, quantity, unit), lines in OTHER_NAMES.items()
    for one, _, said in (line.strip().partition(": ") for line in lines.strip().splitlines())
    for column in [one.rsplit(" = ", 1)]
]


@pytest.mark.parametrize(
    ("protocol", "columns", "said"), [*((kind, {}, "") for kind in KINDS), *NAMED]
)
def test_a_name_that_says_something_else_is_told_and_usual_ones_are_no_matter(
    protocol: str, columns: Mapping[str, Column], said: str, tmp_path: Path, cli: CommandLine
) -> None:
    out = cli("check-file", checked(tmp_path, protocol, columns, ""))
    assert said in out
    assert bool(said) == ("hint: " in out)


@pytest.mark.parametrize(
    ("name", "pressure", "is_told"),
    [
        ("sigma1 (MPa)", "300", True),
        ("sigma1 (MPa)", "400", False),
        ("sigma1-sigma3 (MPa)", "300", False),
    ],
)
def test_a_stress_that_may_hold_the_confining_pressure_is_told(
    name: str, pressure: str, is_told: bool, tmp_path: Path, cli: CommandLine
) -> None:
    columns = {"stress": (name, "MPa", "310")}
    path = checked(tmp_path, "constant_rate", columns, f"sigma3 (MPa) = {pressure}")
    cli("check-file", path)
    said = "is never below column 'sigma3 (MPa)': if it is a total stress along the axis"
    assert (said in cli.out) == is_told


def test_a_unit_that_has_to_be_stated_is_not_said_to_be(tmp_path: Path, cli: CommandLine) -> None:
    path = checked(tmp_path, "rates", {"temperature": ("T (C)", None, "-10")}, "")
    assert "no unit is stated for column 'T (C)', whose name says" in cli(
        "check-file", path, code=2
    )


@pytest.mark.parametrize(
    ("folder", "name", "told"), [("dunite", "dunite_4506", True), ("ice", "PIL40", False)]
)
def test_stated_rates_that_nothing_checks_are_told_of_real_tests(
    folder: str, name: str, told: bool, cli: CommandLine
) -> None:
    assert told == (
        "nothing checks the stated strain rates"
        in cli("check-file", DATA / folder / f"{name}.toml")
    )


def test_strains_over_time_check_the_rates(tmp_path: Path, cli: CommandLine) -> None:
    path = checked(tmp_path, "constant_rate", {"time": ("t (s)", "s", "2000")}, "")
    assert "note: " not in cli("check-file", path)


def test_a_fit_gives_the_same_hints(tmp_path: Path, cli: CommandLine) -> None:
    column = {"strain": ("dL/L0 strain (%)", "percent", "2")}
    path = checked(tmp_path, "constant_rate", column, "")
    told = cli("check-file", path, code=None).splitlines()
    hints = [one for one in told if one.startswith(("hint: ", "note: "))]
    assert [one[:4] for one in hints] == ["hint", "note"]
    assert hints[1] == "note: No times are read, so that nothing checks the stated strain rates."
    cli("fit", path, "--priors", tmp_path / "none.toml", code=2)
    assert cli.error.splitlines()[:-1] == hints


@pytest.mark.parametrize(
    ("protocol", "beside", "words"),
    [
        ("rates", "rate error (%) = 5", "columns not read: 'rate error (%)' (5)"),
        ("constant_rate", "T (C) = -10", "columns not read: 'T (C)' (-10)"),
        *(
            (protocol, "T (C) = -30", "holds mostly 243.15 K, but the test is at 263 K; check both")
            for protocol in ("constant_rate", "attenuation")
        ),
        ("constant_rate", "Strain rate (1/s) = 1e-3", "holds mostly 0.001 1/s, but"),
        *(
            ("constant_rate", agrees, "")
            for agrees in (
                *("T (C) = -10", "T = 150", "Room temperature (C) = 20"),
                "Strain rate (1/s) = 1.4e-5",
            )
        ),
    ],
)
def test_columns_that_are_not_read_are_told_and_compared(
    protocol: str, beside: str, words: str, tmp_path: Path, cli: CommandLine
) -> None:
    path = checked(tmp_path, protocol, {}, beside)
    out = cli("check-file", path)
    assert words in out
    assert words or "check both" not in out


def test_of_many_columns_that_are_not_read_ten_are_named(tmp_path: Path) -> None:
    file = tmp_path / "wide.csv"
    file.write_text(",".join(f"c{k}" for k in range(13)) + "\n" + ",".join("1" * 13) + "\n")
    note = unread_note(look_at(file), {"data": {"stress_column": "c0"}})
    assert note is not None
    assert note.startswith("wide.csv: columns not read: 'c1' (1), ")
    assert note.endswith(", 'c10' (1) and 2 more.")
