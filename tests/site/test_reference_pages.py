"""Tables of the reference are complete, and say what the readers of files do."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest
from combinations import REFUSED, STANDARD, TOGETHER_WITH, Combination, combinations, materials
from conftest import DUNITE, ICE
from file_keys import Key, KeyTable, key_tables, structures
from generated_tables import (
    FREE_IN_HISTORIES,
    TABLES,
    command_lines,
    key_lines,
    main,
    parameter_lines,
)

import pyburgers
from pyburgers.cli.main import COMMANDS
from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import CONDITION_KEYS, of_kind
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.likelihood import NAMES
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.likelihood import LIKELIHOOD
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import CHOICES, variant_of, with_variant

DATA = ICE.parent

SHIPPED = {
    "constant_rate": DUNITE / "dunite_4580.toml",
    "forced_oscillation": DATA / "olivine" / "olivine_twin.toml",
    "loading_history": DATA / "halite" / "halite_z3.toml",
    "attenuation": DATA / "olivine" / "attenuation_A1802.toml",
    "rates": ICE / "rates" / "treverrow_2012.toml",
    "rate_law": DATA / "priors" / "rates" / "ice_composite.toml",
    "priors": DATA / "priors" / "ice.toml",
}

REFERENCE = sorted((DATA.parent / "docs/reference").glob("*.md"))


def tables(name: str) -> dict[str, KeyTable]:
    return {table.heading: table for table in key_tables(structures()[name])}


def key(name: str, heading: str, wanted: str) -> Key:
    return next(found for found in tables(name)[heading].keys if found.name == wanted)


def test_every_kind_of_file_has_its_page() -> None:
    assert set(structures()) == set(SHIPPED)
    assert set(NAMES) < set(structures())


@pytest.mark.parametrize("name", SHIPPED)
def test_every_key_is_explained(name: str) -> None:
    for table in tables(name).values():
        assert table.keys
        for found in table.keys:
            assert found.meaning, f"{name} {table.heading} {found.name}"
            assert found.holds


@pytest.mark.parametrize("name", SHIPPED)
def test_the_keys_of_shipped_files_are_listed(name: str) -> None:
    listed = "\n".join(key_lines(name))
    content = tomllib.loads(SHIPPED[name].read_text(encoding="utf-8"))
    for top, value in content.items():
        held = value[0] if isinstance(value, list) and isinstance(value[0], dict) else value
        if isinstance(held, dict):
            assert (
                f"`[{top}]`" in listed
                or f"`[[{top}]]`" in listed
                or f"`[{top}." in listed
                or (
                    f"| `{top}` |" in listed  # a table of free names, such as [metadata]
                )
            )
        else:
            assert f"| `{top}` |" in listed


@pytest.mark.parametrize("page", REFERENCE, ids=lambda page: page.stem)
def test_commands_for_readers_of_a_checkout_name_tables(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"generated_tables\.py ([a-z_-]+)", text))
    shown = re.findall(r"^```\{file-keys\} (\w+)|^```\{(?!eval-rst|toctree)([a-z-]+)", text, re.M)
    assert named == {kind or table for kind, table in shown if kind or table != "file-keys"}
    assert named <= {*structures(), *TABLES}


def test_a_table_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    main(["attenuation"])
    main(["prior-families"])
    printed = capsys.readouterr().out
    assert "| `amplitude_column` |" in printed
    assert "| `lognormal` |" in printed
    with pytest.raises(SystemExit):
        main(["no-such-table"])


def test_units_defaults_and_choices_are_told() -> None:
    assert key("constant_rate", "", "temperature_K").unit == "K"
    assert key("constant_rate", "", "temperature_K").default == "needed"
    assert key("constant_rate", "[data]", "stress_uncertainty").unit == "`stress_unit`"
    assert key("constant_rate", "[data]", "separator").default == "none"
    assert key("constant_rate", "[[segments]]", "start_strain").unit == "fraction"
    assert key("loading_history", "[[stages]]", "control").holds.count(" or ") == 5
    for protocol in ("constant_rate", "loading_history"):
        assert key(protocol, "[data]", "max_readings").default == "`400`"
    assert key("attenuation", "[data]", "amplitude_column").unit == "`stress_unit`"
    assert key("forced_oscillation", "[oscillation]", "background").default == '`"kept"`'
    assert not tables("constant_rate")["[data]"].needed
    assert tables("attenuation")["[attenuation]"].needed
    assert tables("attenuation")["[[spectra]]"].keys[0].default == "needed"
    assert "[parameters.NAME]" in tables("priors")


def test_a_key_that_is_not_needed_can_be_left_out(tmp_path: Path) -> None:
    """What the table calls needed is what the reader asks for."""
    text = (DUNITE / "dunite_4580.toml").read_text(encoding="utf-8")
    for found in tables("constant_rate")[""].keys:
        if found.default != "needed":
            continue
        lines = [line for line in text.splitlines() if not line.startswith(f"{found.name} =")]
        file = tmp_path / "test.toml"
        file.write_text("\n".join(lines), encoding="utf-8")
        with pytest.raises(InputError, match=f"key '{found.name}' is missing"):
            load_experiment(file)


def test_all_parameters_and_commands_are_listed() -> None:
    text = "\n".join(parameter_lines())
    for parameter in PROGRAM_PARAMETERS:
        assert f"| `{parameter.name}` |" in text


def test_every_command_is_listed_as_its_help_prints_it() -> None:
    text = "\n".join(command_lines())
    for name in (*COMMANDS, "predict test", "predict attenuation"):
        assert f"usage: pyburgers {name}" in text
    assert "--hold-time-h H" in text
    assert "draws of each chain; default 1000" in text


def test_keys_that_tables_of_attenuation_refuse_are_not_listed(tmp_path: Path) -> None:
    shutil.copy(DATA / "ice" / "attenuation_twin.csv", tmp_path)
    text = (DATA / "ice" / "attenuation_twin.toml").read_text(encoding="utf-8")
    listed = {found.name for found in tables("attenuation")[""].keys}
    for sd_key, apparatus_key in CONDITION_KEYS.values():
        assert not {sd_key, apparatus_key} & listed
        for line in (f"{sd_key} = 0.01", f'{apparatus_key} = "A"'):
            file = tmp_path / "test.toml"
            file.write_text(f"{line}\n{text}", encoding="utf-8")
            with pytest.raises(InputError, match=sd_key):
                load_experiment(file)
    assert {key for keys in CONDITION_KEYS.values() for key in keys} <= {
        found.name for found in tables("constant_rate")[""].keys
    }


def test_values_of_parameters_that_are_left_out_are_those_of_a_fit() -> None:
    rows = {line.split(" | ")[0]: line for line in parameter_lines() if " | " in line}
    assert rows["| `kelvin_stress_exponent`"].endswith("| 1 |")
    assert rows["| `breakdown_stress`"].endswith("| 0 Pa |")
    history = of_kind(load_experiment(SHIPPED["loading_history"]), HistoryExperiment)
    plain = default_priors(history.material, history.protocol)
    (priors,) = LIKELIHOOD.own_priors([history], plain)
    for name in FREE_IN_HISTORIES:
        assert name not in plain.priors
        assert not priors[name].is_fixed
        assert "loading_history.md" in rows[f"| `{name}`"]


def test_every_document_is_on_the_site() -> None:
    docs = DATA.parent / "docs"
    listed = (docs / "index.md").read_text(encoding="utf-8").splitlines()
    for document in docs.glob("*.md"):
        assert document.stem in [*listed, "index"], f"docs/index.md does not list {document.name}"
    parts = [line.removeprefix(":caption: ") for line in listed if line.startswith(":caption: ")]
    assert parts == ["Tutorials", "How to", "Reference", "Explanation"]


def test_every_public_name_is_on_the_page_of_python() -> None:
    page = (DATA.parent / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    shown = {line.split(":: ")[1] for line in page.splitlines() if line.startswith(".. auto")}
    assert shown == set(pyburgers.__all__)


@pytest.fixture(scope="module")
def found() -> list[Combination]:
    return combinations()


def test_every_combination_is_tried_once(found: list[Combination]) -> None:
    tried = [(c.material, c.protocol, c.part, c.law) for c in found]
    laws = sum(len(laws) for laws in CHOICES.values())
    assert len(tried) == len(set(tried)) == laws * len(NAMES) * len(materials())
    for c in found:
        assert (c.outcome == REFUSED) == bool(c.reason)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_tests_take_the_laws_that_the_table_allows(
    name: str, found: list[Combination]
) -> None:
    experiment = load_experiment(SHIPPED[name])
    priors = default_priors(experiment.material, name)
    for c in found:
        if (c.material, c.protocol) != (experiment.material, name):
            continue
        choice = {**TOGETHER_WITH.get(c.outcome, {}), c.part: c.law}
        if c.outcome == REFUSED:
            with pytest.raises(InputError):
                with_variant(priors, experiment, choice)
            continue
        assert (
            variant_of(with_variant(priors, experiment, choice), experiment).record()[c.part]
            == c.law
        )
        if c.outcome == STANDARD:
            assert variant_of(priors, experiment).record()[c.part] == c.law


def test_what_depends_on_readings_stands_above_the_tables() -> None:
    page = DATA.parent / "docs" / "reference" / "combinations.md"
    said = " ".join(page.read_text(encoding="utf-8").split())
    history = of_kind(load_experiment(SHIPPED["loading_history"]), HistoryExperiment)
    (priors,) = LIKELIHOOD.own_priors([history], default_priors(history.material, history.protocol))
    law = variant_of(priors, history).residuals
    assert f"whose strain is read takes `residuals={law}`" in said
    without_scatter = [
        material
        for material in materials()
        if is_fixed_at(default_priors(material, "attenuation")["attenuation_scatter"], 0.0)
    ]
    assert f"with the priors of {' and '.join(without_scatter)}, which" in said


@pytest.mark.parametrize("law", CHOICES["third_mechanism"])
def test_a_third_mechanism_is_listed_with_its_second_one(
    law: str, found: list[Combination]
) -> None:
    page = (DATA.parent / "docs" / "reference" / "combinations.md").read_text(encoding="utf-8")
    possible = [c for c in found if (c.part, c.law) == ("third_mechanism", law) and not c.reason]
    others = [TOGETHER_WITH.get(c.outcome, {}) for c in possible]
    assert {"second_mechanism" in choice for choice in others} == {law != "none"}
    assert all(f"with `{part}={own}` too" in page for one in others for part, own in one.items())
