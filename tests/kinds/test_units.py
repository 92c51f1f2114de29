"""The table of units: a unit that stands there is read, guessed, written and described."""

import re
from pathlib import Path

import numpy as np
import pytest

from pyburgers.cli.main import main
from pyburgers.common.cells import are_units, is_unit
from pyburgers.common.units import UNIT_TABLE, Unit, units_text
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.column_names import unit_in_name
from pyburgers.kinds.loading_history.files import load_loading_history

COLUMN_NAMES = {
    "stress": "stress",
    "strain": "strain",
    "time": "time",
    "frequency": "freq",
    "temperature": "temp",
    "angle": "delta",
    "strain rate": "rate",
    "length": "grain size",
    "relative error": "error",
}
"""A name of a column of each quantity whose unit names can say."""

ALL_UNITS = [
    pytest.param(quantity, name, unit, id=f"{quantity} {name}")
    for quantity, units in UNIT_TABLE.items()
    for name, unit in units.items()
]
TOLD_UNITS = [one for one in ALL_UNITS if one.values[0] in COLUMN_NAMES]

HISTORY = {"time": [600.0, 1200.0, 1800.0], "strain": [2e-3, 3e-3, 4e-3], "stress": [1e6] * 3}
SPECTRUM = {
    "frequency": [1.0, 0.1, 0.01],
    "temperature": [263.0, 264.0, 265.0],
    "angle": np.arctan([0.1, 0.2, 0.3]).tolist(),
}
WRITTEN_UNITS = [one for one in TOLD_UNITS if one.values[0] in {**HISTORY, **SPECTRUM}]
SI_UNITS = {"strain": "fraction", "stress": "Pa", "frequency": "Hz", "angle": "rad"}


def in_unit(values: list[float], unit: Unit) -> list[float]:
    return [(value - unit.zero) / unit.factor for value in values]


def fresh_experiment(folder: Path, quantity: str, name: str, unit: Unit) -> Path:
    """File that `new` writes for a table whose only unit that is not SI is one of `quantity`."""
    columns = HISTORY if quantity in HISTORY else SPECTRUM
    units = {"time": "s", "temperature": "K", **SI_UNITS, quantity: name}
    titles = [f"{COLUMN_NAMES[one]} ({units[one]})" for one in columns]
    numbers = [
        in_unit(values, unit if one == quantity else Unit()) for one, values in columns.items()
    ]
    rows = [",".join(map(repr, row)) for row in zip(*numbers, strict=True)]
    path = folder / "table.csv"
    path.write_text("\n".join([",".join(titles), *rows]) + "\n", encoding="utf-8")
    answers = ["--id", "x", "--material", "ice", "--grain-size-m", "1e-3", "--source", "s"]
    answers += ["--temperature-K", "263", "--kind", "measured"]
    if columns is SPECTRUM:
        answers += ["--deformation", "axial"]
    main(["new", str(path), *answers])  # warns of an odd table, which is none of this test
    return path.with_suffix(".toml")


def test_every_quantity_with_spelled_units_is_tested() -> None:
    spelled = {
        quantity
        for quantity, units in UNIT_TABLE.items()
        if any(unit.spelling for unit in units.values())
    }
    assert spelled == COLUMN_NAMES.keys()


@pytest.mark.parametrize(("quantity", "name", "unit"), ALL_UNITS)
def test_a_unit_stands_in_a_row_of_units_and_in_descriptions(
    quantity: str, name: str, unit: Unit
) -> None:
    assert is_unit(name)
    assert unit.factor > 0
    assert re.search(rf"(^| ){re.escape(name)}($|,| )", units_text(quantity))


@pytest.mark.parametrize(("quantity", "name", "unit"), TOLD_UNITS)
def test_the_name_of_a_column_says_its_unit(quantity: str, name: str, unit: Unit) -> None:
    kind = "attenuation" if quantity == "angle" else quantity
    assert unit_in_name(f"{COLUMN_NAMES[quantity]} ({name})", kind) == name


@pytest.mark.parametrize(("quantity", "name", "unit"), WRITTEN_UNITS)
def test_new_writes_a_unit_that_reads_back_to_si(
    quantity: str, name: str, unit: Unit, tmp_path: Path
) -> None:
    path = fresh_experiment(tmp_path, quantity, name, unit)
    assert f'= "{name}"' in path.read_text(encoding="utf-8")
    if quantity in HISTORY:
        history = load_loading_history(path)
        np.testing.assert_allclose(history.time, HISTORY["time"])
        strain = history.reading[history.response_is_strain]
        np.testing.assert_allclose(strain, HISTORY["strain"])
        np.testing.assert_allclose(history.largest_stress, 1e6)
    else:
        conditions = load_attenuation(path).conditions
        np.testing.assert_allclose(1 / conditions.period, SPECTRUM["frequency"])
        np.testing.assert_allclose(conditions.temperature, SPECTRUM["temperature"])
        tan_delta = load_attenuation(path).readings.tan_delta
        np.testing.assert_allclose(tan_delta, np.tan(SPECTRUM["angle"]))


@pytest.mark.parametrize("key", ["time", "stress", "strain", "frequency", "temperature", "angle"])
def test_the_keys_of_files_describe_every_unit_of_their_quantity(key: str) -> None:
    from pyburgers.kinds.attenuation.files import _DataTable
    from pyburgers.kinds.loading_history.readings import HistoryDataTable

    fields = {**HistoryDataTable.model_fields, **_DataTable.model_fields}
    name = "attenuation_unit" if key == "angle" else f"{key}_unit"
    assert units_text(key) in (fields[name].description or "")


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("Stress (10^6 Pa)", "stress"),
        ("Stress ×10⁶ Pa", "stress"),
        ("Time [10**3 s]", "time"),
        ("Strain (x 10-3)", "strain"),
        ("Frequency 1e-3 Hz", "frequency"),
        ("Strain x 10 (%)", "strain"),
        ("100*Strain", "strain"),
        ("Stress MPa/10", "stress"),
        ("(σ1-σ3)/2 (MPa)", "stress"),
        ("½(σ1-σ3) (MPa)", "stress"),
        ("Half period (s)", "time"),
        ("Amplitude peak to peak (MPa)", "stress"),
        ("RMS amplitude (MPa)", "stress"),
        ("rate (1e-9/s)", "strain rate"),
    ],
)
def test_a_unit_with_a_factor_is_another_one(name: str, kind: str) -> None:
    assert unit_in_name(name, kind) == ""


@pytest.mark.parametrize(
    ("kind", "names"),
    {
        "stress": "stress (kp/cm²); stress (hectopascal); Spannung (N/cm²); Stress (x10 MPa); G/G0"
        "; G (10 GPa); G error (%); stress rel. error; Normalized modulus; Modulus (-)"
        "; stress 2 sigma (MPa); Stress dyn/cm2; Stress N/cm2; Stress torr",
        "strain": "Strain (mm/m); strain (ppm); Strain gauge (mV); Dehnung (Promille)"
        "; Strain (10E-3); Strain %o; Dehnung in Promille; strain rel. error",
        "time": "Zeit (Wochen); Time (ks); Time (microseconds); Time (milliseconds); Zeit in Wochen"
        "; LogPeriod (s); logTime; Zeit Jahre; Temps semaines",
        "frequency": "logFreq; Frequency (kHz); freq (rad/min); angular frequency (Hz)"
        "; Normalised frequency",
        "strain rate": "rate (%/s); strain_rate_per_year; -log10 rate (1/s); rate (1/h)",
        "length": "grain_size_cm; log10 d (um); area (mm²)",
        "relative error": "error (2 sigma); stress_sd (MPa)",
        "temperature": "Temperature (F); T (°Ra)",
        "attenuation": "tan delta (x100); 100 tan delta; Attenuation Q; Q (tan delta inverse); Q"
        "; log10(1/Q) error; tan delta rel. error; tan delta error (%); Q⁻¹ (10⁻³); loss angle"
        "; specific loss ΔE/E; energy loss per cycle; log decrement",
    }.items(),
)
def test_a_unit_that_files_do_not_know_is_not_passed_over(kind: str, names: str) -> None:
    found = {name: unit_in_name(name, kind) for name in names.split("; ")}
    assert found == dict.fromkeys(found, "")


@pytest.mark.parametrize(
    ("kind", "unit", "names"),
    [
        ("stress", "kPa", "stress (kilopascal); σ [kPa]; Spannung in kPa"),
        ("stress", "bar", "stress (bars); Druck [bar]"),
        ("stress", "kbar", "Stress (kbar); stress_kilobar"),
        ("strain", "microstrain", "strain (µm/m); Dehnung (µε); ustrain"),
        ("time", "d", "Zeit (Tage); Zeit in Tagen; Zeit Tage; Temps jours; t [d]; time_days"),
    ],
)
def test_a_unit_is_known_by_its_spellings(kind: str, unit: str, names: str) -> None:
    found = {name: unit_in_name(name, kind) for name in names.split("; ")}
    assert found == dict.fromkeys(found, unit)


@pytest.mark.parametrize(
    ("kind", "unit", "names"),
    [
        (
            "stress",
            "MPa",
            "Stress (MPa, true); σ1-σ3 (MPa); Stress (N/mm²); Stress (MPa) true; q (MPa)",
        ),
        ("stress", "GPa", "E' (GPa); |E*| (GPa); E(t) (GPa)"),
        ("stress", None, "Stress (true); Stress (σ1-σ3); Stress (LVDT 2); Stress (1); E(t)"),
        (
            "strain",
            "percent",
            "Dehnung (Prozent); Strain (percent, true); strain err (%); Dehnung in %",
        ),
        ("strain", "fraction", "Strain (-); strain (m/m); strain (mm/mm); Axial strain (fraction)"),
        ("strain", None, "Strain (dimensionless); Strain (axial)"),
        ("time", "h", "Zeit (Stunden); Période (heures); Time (hrs)"),
        ("time", "s", "Zeit (Sekunden); Temps (secondes); Time (secs.); Time since start (s)"),
        ("time", "min", "Time (minutes); Zeit (Minuten)"),
        ("frequency", "rad/s", "omega (1/s); Frequency (rad/s)"),
        ("temperature", "C", "Temperature (deg C); Temp (°C, furnace); T (degC)"),
        (
            "attenuation",
            None,
            "Internal friction (Q^-1); tan(delta); log10(1/Q); logQinv; tan δ (-); Q⁻¹",
        ),
        ("attenuation", "deg", "phase (degrees); phase lag (°)"),
        ("strain rate", "1/s", "strain_rate_per_s; rate (s⁻¹); rate per second"),
        ("strain rate", "1e-6/s", "rate (10⁻⁶ s⁻¹); rate (1e-6 1/s)"),
        ("strain rate", None, "minimum/mean rate"),
        ("length", "um", "d (µm); grain size in um; microns"),
        ("relative error", "percent", "rel. error (%)"),
    ],
)
def test_words_in_brackets_are_no_units_and_units_have_many_spellings(
    kind: str, unit: str | None, names: str
) -> None:
    found = {name: unit_in_name(name, kind) for name in names.split("; ")}
    assert found == dict.fromkeys(found, unit)


@pytest.mark.parametrize(
    "name",
    [
        *("Stress 2010-11-05 (MPa)", "Stress 10-11-2010 (MPa)", "Stress 2/10/2024 (MPa)"),
        *(
            "Stress LVDT 1/2 (MPa)",
            "max 10 Stress (MPa)",
            "Stress, second half (MPa)",
            "|E*| (MPa)",
        ),
    ],
)
def test_a_date_or_a_number_is_no_factor(name: str) -> None:
    assert unit_in_name(name, "stress") == "MPa"


@pytest.mark.parametrize("factor", ["1e-6", "10^-6", "×10⁻⁶", "10-6"])
def test_a_row_of_units_may_have_a_factor(factor: str) -> None:
    assert are_units(["s", "MPa", factor])
    assert are_units(["Stunden", "Prozent", factor])
    assert are_units(["Unit", "s", f"{factor} Pa"])
    assert not are_units(["Unit", "1e-5", "-"])
    assert not are_units(["1e-5", "-", "1e-3"])
    assert not are_units(["s", "MPa", "1000"])
