"""`pyburgers fit-rates`: files, exit codes, the page, refusals."""

import io
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ICE
from figure_texts import legend_texts
from refusals import CommandLine

from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.program_data import lines
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.page.glossary import with_definitions
from pyburgers.page.rate_section import law_figure, rate_section

RATES = ICE / "rates"
SHORT = ("--chains", "2", "--warmup", "100", "--draws", "60", "--seed", "1")


@pytest.mark.usefixtures("sketched")
def test_tables_are_fitted_held_out_checked_and_shown(tmp_path: Path, cli: CommandLine) -> None:
    out = tmp_path / "run"
    tables = [str(RATES / f"{name}.toml") for name in ("fan_2020", "qi_2017", "qi_goldsby_2021")]
    printed = cli("fit-rates", *tables, "--hold-out", "qi_2017", "--out", out, *SHORT, code=None)
    code = cli.code
    checks = json.loads((out / "checks.json").read_text(encoding="utf-8"))["checks"]
    failed = {check["kind"] for check in checks if not check["passed"]}
    assert code == (3 if "sampling" in failed else 4 if failed else 0)
    assert "stress exponent, creep" in printed
    assert "inside the 90 % band" in printed
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["held_out"] == ["qi_2017"]
    assert manifest["status"] == "complete"
    for name in ("posterior.nc", "summary.csv", "flow_law.png", "flow_law.svg"):
        assert (out / name).is_file()
    assert not (out / "flow_law_prior.json").exists()
    # What is drawn and counted are the tests that were fitted.
    figure = law_figure(fit := RateFit.load(out))
    assert f"{fit.used.n_rows} tests" in figure.axes[0].get_title(loc="left")
    counts = [text.split()[0] for text in legend_texts(figure) if "test" in text]
    assert sum(map(int, counts)) == fit.used.n_rows == fit.data.n_rows - 9
    drawn = np.array([line.stress for line in lines(fit.used)])
    assert fit.posterior["predictions"]["stress"].to_numpy() == pytest.approx(drawn)
    assert "along temperature" in cli("check", out, code=code)
    cli("report", out, "--out", tmp_path / "page")
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert "Flow law of ice from steady rates" in page
    assert "Sources that were predicted" in page
    assert "SYNTHETIC" not in page
    sources = "Specimens differ by a factor of their rate, sources by a factor"
    assert sources in page
    assert ", held-out ones among them).</p>" in page


def test_rows_that_are_left_out_are_told_and_authors_are_no_technical_words(
    tmp_path: Path, cli: CommandLine
) -> None:
    text = (RATES / "fan_2020.toml").read_text("utf-8").replace('source = "', 'source = "Prior & ')
    (tmp_path / "fan_2020.toml").write_text(text, encoding="utf-8")
    rows = pd.read_csv(RATES / "fan_2020.csv")
    rows.loc[1, "grain_size_mm"] = np.nan
    rows.to_csv(tmp_path / "fan_2020.csv", index=False)
    cli("fit-rates", tmp_path / "fan_2020.toml", "--out", tmp_path / "run", *SHORT, code=None)
    assert "note: fan_2020: 1 row without grain size left out." in cli.error
    cited, *_ = rate_section(RateFit.load(tmp_path / "run")).details
    assert "(measured data: Prior &amp; " in with_definitions(cited)


@pytest.mark.usefixtures("sketched")
def test_a_run_gets_more_draws_and_is_replaced(tmp_path: Path, cli: CommandLine) -> None:
    out = tmp_path / "run"
    command = ["fit-rates", str(RATES / "fan_2020.toml"), "--out", str(out), *SHORT]
    for further, draws in (([], 60), (["--more-draws", "20"], 80)):
        cli(*command, *further, code=None)
        assert RateFit.load(out).posterior["posterior"].sizes["draw"] == draws
    stale = out / "flow_law_prior.json"
    stale.write_text("{}", encoding="utf-8")
    others = [*command, "--law", "ice_flow_law"]
    cli.refused(others, "holds a run of other inputs", "--overwrite to replace it")
    cli(*others, "--overwrite", code=None)
    assert RateFit.load(out).law.power_law.has_beta
    assert not stale.exists()
    again = [*others, "--overwrite", "--more-draws", "20"]
    cli.refused(again, "--more-draws 20: found it beside --overwrite")


@pytest.mark.usefixtures("sketched")
def test_a_softened_table_has_a_prior_to_hand_on_and_is_exported(
    tmp_path: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, number in (("N_CANDIDATES", 600), ("N_MATERIALS", 30), ("LEAST_MATERIALS", 5)):
        monkeypatch.setattr(f"pyburgers.flow_law_tables.softening.{name}", number)
    out, table = tmp_path / "run", str(RATES / "qi_goldsby_2021.toml")
    own = ("--without", str(ICE / "PIL40.toml"), "--curve-priors", "ice")
    cli("fit-rates", table, "--out", out, *own, *SHORT, code=None)
    code = cli.code
    assert "1 of 23 rows may be" in cli.error
    law = FlowLawPrior.load(out / "flow_law_prior.json")
    assert law.mean.shape == (4,)
    assert len(law.tests) == 22
    assert "along stress" in cli("check", out, code=code)
    exported = pd.read_csv(io.StringIO(cli("export", out, "--format", "csv")), index_col="name")
    summary = pd.read_csv(out / "summary.csv", index_col="parameter")
    for name, own_name in (
        ("stress_exponent", "stress_exponent[creep]"),
        ("rate_scatter", "rate_scatter"),
    ):
        assert exported["mean"][name] == pytest.approx(summary["mean"][own_name])
    assert "ln_flow_law_factor" in exported.index
    cli("report", out, "--out", tmp_path / "page")
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert "scatters about them: the latter is what a curve can take" in page
    assert "Specimens differ by a factor of their rate." in page  # of one source
    (anchor,) = set(re.findall(r'href="#(verdicts-\w+)"', page))  # from contents and overview
    assert page.count(f'id="{anchor}"') == 1
    cli.refused(["export", out, "--test", "PIL40"], "--test: found PIL40, expected none")


def test_names_that_say_something_else_than_the_file_are_told(
    tmp_path: Path, cli: CommandLine
) -> None:
    for end in ("csv", "toml"):
        text = (RATES / f"fan_2020.{end}").read_text("utf-8")
        text = text.replace("temperature_C", "temperature_F")
        (tmp_path / f"fan_2020.{end}").write_text(text, encoding="utf-8")
    command = ["fit-rates", str(tmp_path / "fan_2020.toml"), "--law", str(tmp_path / "none.toml")]
    cli(*command, code=2)
    assert "hint: " in cli.error
