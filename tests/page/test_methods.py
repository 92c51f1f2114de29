"""Methods and references of fits, to copy into a paper."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from page import page_of
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit

from pyburgers.checks.fit_checks import CheckKind
from pyburgers.checks.verdicts import ANSWERS
from pyburgers.common.toml_files import read_tables
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.experiment import Provenance
from pyburgers.page.methods import bibtex, methods_text

ENTRY = re.compile(r"^@(\w+)\{(\w+),\n(.*?)\n\}$", re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    folder = tmp_path_factory.mktemp("run")
    source = Provenance("measured", "Glen & Nye_2 {50 %}", doi="10.1/a_b")
    return make_fit(folder, kind="measured", provenance=source, chains=2, draws=600)


def told(fit: Fit, **changes: Any) -> str:
    fit = replace(fit, manifest={**fit.manifest, **changes})
    return methods_text(fit, fit.checks(), fit.verdicts())


def test_methods_state_laws_priors_sampler_checks_and_verdicts(fit: Fit, tmp_path: Path) -> None:
    oscillating = make_olivine_fit(tmp_path, chains=2, draws=50)
    for one in (fit, oscillating):
        text, sampler = told(one), one.manifest["sampler"]
        assert f"Laws: {one.variant.text}." in text
        assert f"Priors: {one.priors.title} (" in text
        assert f"{sampler['draws']} draws, seed {sampler['seed']}, target acceptance 0.9" in text
        assert all(check.name in text for check in one.checks())
        for kind in CheckKind:
            assert ANSWERS[kind][one.verdicts()[kind].outcome] in text
    assert "grain size piezometric, fabric constant" in told(oscillating)


def test_methods_say_where_the_data_were_left_out_or_other_tests_took_part(fit: Fit) -> None:
    assert "all draws are of the prior" not in told(fit)
    assert "all draws are of the prior" in told(fit, use_likelihood=False)
    kinds = {"maxwell_modulus": "shared", "beta": "shared", "stress_exponent": "separate"}
    kinds["kelvin_stress_exponent"] = "shared"  # known here
    together = told(fit, experiments=["A", "B"], pooling={"kinds": kinds})
    assert "(shared: maxwell modulus, beta; separate: stress exponent)" in together


def test_methods_of_a_failed_check_name_it(tmp_path: Path) -> None:
    failed = told(make_fit(tmp_path, chains=2, draws=300, divergences=5, apart=3.0))
    assert "not passed: R-hat" in failed


def entries(text: str) -> Mapping[str, str]:
    """Return what stands in each entry by its key."""
    return {key: content for _, key, content in ENTRY.findall(text)}


def test_references_are_whole_entries_of_data_model_and_software(fit: Fit, tmp_path: Path) -> None:
    synthetic = make_fit(tmp_path, name="B", chains=2, draws=50)
    text = bibtex([fit, fit, synthetic])
    found = entries(text)
    assert [*found] == ["data_1", "burgers_mcmc", "stan", "arviz", "pyburgers"]
    assert r"title = {{Glen \& Nye\_2 50 \%}}" in found["data_1"]
    assert "doi = {10.1/a_b}" in found["data_1"]
    assert all(content.count("{") == content.count("}") for content in found.values())
    assert ENTRY.sub("", text).strip() == ""


def test_references_are_those_of_the_citation_file(fit: Fit) -> None:
    citation = (Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8")
    project = read_tables(Path(__file__).parents[2] / "pyproject.toml")["project"]
    found = entries(bibtex([fit]))
    assert f"Version {project['version']}" in found["pyburgers"]
    assert "The pyburgers developers" in citation
    for name in re.findall(r"family-names: (\w+)", citation):
        assert name in found["burgers_mcmc"] + found["stan"]
    for doi in re.findall(r"doi: (\S+)", citation):
        assert doi in found["stan"]


def test_the_page_has_methods_and_references_folded_at_its_end(
    fit: Fit, sketched: None, tmp_path: Path
) -> None:
    page = page_of([fit], tmp_path)
    assert told(fit) in page.text_without_marks
    assert f"{fit.experiment.id} (ice, constant rate, 260 K; measured data: Glen" in page.text
    assert "@misc{pyburgers" in page.text
    assert "@misc{pyburgers" not in page.unfolded
