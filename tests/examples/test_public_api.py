"""Whatever shows how the package is used does it by its public names alone."""

import ast
import json
import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sentences import documents

import pyburgers
from pyburgers import (
    DesignPlan,
    Fit,
    InputError,
    Regime,
    SamplerOptions,
    compare,
    compare_by_test,
    design,
    export,
    fit,
    fit_rates,
    flow_rate,
    load_experiment,
    load_rate_table,
    plot,
    plot_priors,
    predict_attenuation,
    prediction_figure,
    prior_draws,
    priors,
    report,
    shipped_folder,
    task_of,
)

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def code_cells(notebook: Path) -> list[str]:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


SOURCES = {
    str(path.relative_to(ROOT)): code
    for path, code in (
        *(
            (path, path.read_text(encoding="utf-8"))
            for folder in ("examples", "docs/gallery", "reports")
            for path in sorted((ROOT / folder).rglob("*.py"))
        ),
        *((path, "\n".join(code_cells(path))) for path in sorted(ROOT.glob("notebooks/*.ipynb"))),
        *((path, "\n".join(BLOCK.findall(path.read_text("utf-8")))) for path in documents()),
    )
    if "pyburgers" in code
}


def used_of_the_package(source: str) -> set[str]:
    """Names of the package that a file uses, those of modules with their dots."""
    used = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "pyburgers":
            inside = (node.module or "").removeprefix("pyburgers").lstrip(".")
            used |= {f"{inside}.{alias.name}".lstrip(".") for alias in node.names}
        elif isinstance(node, ast.Import):
            modules = {alias.name for alias in node.names}
            used |= {name for name in modules if name.startswith("pyburgers.")}
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "pyburgers":
            used.add(node.attr)
    return used


@pytest.mark.parametrize("name", SOURCES)
def test_public_names_suffice(name: str) -> None:
    assert used_of_the_package(SOURCES[name]) <= {*pyburgers.__all__, "__version__"}


def test_code_of_every_sort_is_read() -> None:
    assert {
        "README.md",
        "docs/gallery/prior_curves.py",
        "docs/tutorials/stan_functions.md",
        "examples/reuse_stan_functions/flow_stress.py",
        "notebooks/own_curve.ipynb",
        "reports/study.py",
    } <= SOURCES.keys()


def test_another_import_is_seen() -> None:
    for line, name in (
        ("from pyburgers.fitting.fit import Fit", "fitting.fit.Fit"),
        ("import pyburgers.fitting.fit as f", "pyburgers.fitting.fit"),
        ("pyburgers.fitting.fit", "fitting"),
    ):
        assert name in used_of_the_package(line)
        assert name not in pyburgers.__all__


LAW: Mapping[str, float] = {
    "stress_exponent": 4.0,
    "grain_size_exponent": 0.4,
    "activation_enthalpy": 62e3,
    "beta": -7.29e-4,
}


def other(value: object) -> Any:
    """A value of a type that types refuse where it stands."""
    return value


RATES = load_rate_table(shipped_folder("data") / "ice" / "rates" / "fan_2020.toml")


def resolved(stress: object, _: Fit) -> object:
    return priors("ice").resolved(other(stress))


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda run: fit(other("test.toml")), "experiments: found 'test.toml', expected a test"),
        (lambda run: fit([]), "experiments: found none, expected a test or several"),
        (lambda run: fit(other(run)), "experiments: found Fit, expected a test"),
        (lambda run: fit(run.experiment, other("ice")), "priors: found 'ice', expected a set"),
        (
            lambda run: run.predict(other("test.toml")),
            "experiment: found 'test.toml', expected a test",
        ),
        (lambda run: compare(other([run, run])), "fits: found list, expected fits by name"),
        (lambda run: report(other("run"), "page"), "fits: found 'run', expected a list of fits"),
        (lambda run: report([other("run")], "page"), "fits: found 'run', expected a fit"),
        (lambda run: export(other("run"), "json"), "fit: found 'run', expected a fit"),
        (lambda run: predict_attenuation(other("run")), "fit: found 'run', expected a fit"),
        (
            lambda run: predict_attenuation(run, [0.1], other(Regime(1e6, 1e5))),
            "regimes: found Regime, expected a list",
        ),
        (lambda run: run.priors.with_(beta=-7e-4), "beta: found -0.0007, expected a prior"),
        (lambda run: SamplerOptions(chains=other(2.5)), "chains: found 2.5, expected a whole"),
        (
            lambda run: run.predict(run.experiment, draws=other(2.5)),
            "draws: found 2.5, expected a whole number",
        ),
        (
            lambda run: export(run, "aspect", grain_size=other("1e-3")),
            "grain_size: found '1e-3', expected a number",
        ),
        (lambda _: Regime(other("1"), 2.0), "median_stress: found '1', expected a stress"),
        (lambda _: load_experiment(other(5)), "path: found 5, expected the path of"),
        (
            lambda run: compare_by_test(other([run, run])),
            "joints: found list, expected fits by name",
        ),
        (
            lambda _: compare_by_test({"one": other("run")}),
            "joints: one: found 'run', expected a fit",
        ),
        (
            lambda run: fit(run.experiment, run.priors, options=other({"chains": 2})),
            "options: found dict, expected options",
        ),
        (
            lambda _: fit_rates(other(["table.toml"]), out="run"),
            "tables: found 'table.toml', expected a table",
        ),
        (
            lambda _: fit_rates(other("table.toml"), out="run"),
            "tables: found 'table.toml', expected a table",
        ),
        (
            lambda _: fit_rates(RATES, other("ice_composite"), out="run"),
            "law: found 'ice_composite', expected a law",
        ),
        (
            lambda _: fit_rates(RATES, out="run", held_out="fan_2020"),
            "held_out: found 'fan_2020', expected a list",
        ),
        (
            lambda _: fit_rates(RATES, out="run", curve=other("ice")),
            "curve: found 'ice', expected a set of priors",
        ),
        (
            lambda _: fit_rates(RATES, out="run", more_draws=other("3")),
            "more_draws: found '3', expected a whole number",
        ),
        (
            lambda run: fit(run.experiment, more_draws=100),
            "more_draws: found 100 without out, expected the folder of the run",
        ),
        (
            lambda run: task_of(run.experiment, other("ice"), SamplerOptions()),
            "priors: found 'ice', expected a set",
        ),
        (
            lambda run: task_of(run.experiment, run.priors, other({"chains": 2})),
            "options: found dict, expected options",
        ),
        (
            lambda run: predict_attenuation(run, [1], temperature=other([260, 270])),
            "temperature: found list, expected one number",
        ),
        (
            lambda run: predict_attenuation(run, [1], other([(1e6, 1e5)])),
            "regimes: found tuple, expected stresses",
        ),
        (
            lambda run: export(run, "tidalpy", regime=other((1e6, 1e5))),
            "regime: found tuple, expected stresses",
        ),
        (
            lambda run: export(run, "json", draws=other(2.5)),
            "draws: found 2.5, expected a whole number",
        ),
        (lambda run: prediction_figure(other(run)), "prediction: found Fit, expected a prediction"),
        (lambda _: plot(other("ice")), "experiment: found 'ice', expected a test"),
        (lambda _: plot_priors(other("ice")), "priors: found 'ice', expected a set"),
        (
            lambda _: priors("ice").sample(np.random.default_rng(1)),
            "stress_noise: found a prior that is a share of the largest stress, expected one in Pa",
        ),
        *(
            (partial(resolved, wrong), f"max_stress: found {found}, expected a")
            for wrong, found in (("2 MPa", "'2 MPa'"), (-2e6, "-2e+06 Pa"), (math.nan, "nan Pa"))
        ),
        (lambda _: shipped_folder("foo"), "name: found 'foo', expected 'data' or 'stan'"),
        (lambda _: fit_rates([], out="run"), "tables: found none, expected a table"),
        (
            lambda run: design(run, DesignPlan(("maxwell_modulus",), {})),
            "candidates: found none, expected at least one",
        ),
        (
            lambda run: prior_draws(run.experiment, run.priors, draws=0),
            "draws: found 0, expected at least 1",
        ),
        (lambda run: run.to_arviz(prior_draws=-1), "prior_draws: found -1, expected at least 0"),
        (lambda run: run.experiment.to_toml("missing/x.toml"), "found no folder"),
        (
            lambda _: flow_rate({**LAW}, 1e6, temperature=other([260.0, 270.0]), grain_size=1e-3),
            "temperature: found list, expected one number",
        ),
        (
            lambda _: flow_rate(LAW, other("a"), temperature=263.0, grain_size=1e-3),
            "stress: found 'a', expected numbers",
        ),
        (
            lambda _: flow_rate(LAW, [1e6, 2e6, 3e6], temperature=263.0, grain_size=[1e-3, 1e-2]),
            "found the shapes (), (2,), (3,), expected ones that broadcast",
        ),
    ],
)
def test_an_argument_of_another_type_is_told(
    call: Callable[[Fit], object], told: str, small_fit: Fit
) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        call(small_fit)
