"""Numbers and texts of the package beside stored ones, which a change of the code must not move.

Three files hold them: `densities.json` (log density, its gradient and log likelihoods of tests at
one or three points each), `fits.json` (summaries of four short fits of four kinds) and `page.json`
(text and numbers of two pages, one of them about these fits). To store new values, which a commit
has to justify:

    BASELINE=write python -m pytest tests/baseline

Densities are compared to 1e-9. What the solver itself errs by comes on top: it is the change of the
same numbers from a tolerance of 1e-12 to 3e-13, measured when they are stored. Fits of the same
program on the same processor have the same draws bit by bit, and then their summaries and their
page have to be equal. Draws of a program that rounds otherwise part ways after some steps: means
and spreads are then compared within the Monte Carlo error, and only the page about made-up draws is
compared.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import sketch_pictures, with_fixed
from log_density import program_with
from page import Page
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit

from pyburgers import (
    Fit,
    SamplerOptions,
    SolverOptions,
    fit,
    load_experiment,
    load_priors,
    with_variant,
)
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import StanData
from pyburgers.kinds.together import pooling_for
from pyburgers.page.page import write_report

RecordProperty = Callable[[str, object], None]
pytestmark = pytest.mark.usefixtures("programs")

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[1]
IS_WRITTEN = os.environ.get("BASELINE") == "write"

RELATIVE_LIMIT = 1e-9
"""Of densities and log likelihoods."""

GRADIENT_LIMIT = 1e-8
"""Over the largest component: gradients come from differences of positions, which are rounded."""

SOLVER_NOISE_MARGIN = 10.0
"""How often the measured error of the solver may be found as a difference."""

TOLERANCE, TIGHTER_TOLERANCE = 1e-12, 3e-13
"""Of the solver: that of the stored values, and the one that measures its error."""


@dataclass(frozen=True)
class Case:
    """Tests that are fitted together and points where densities are stored; paths from the root."""

    files: tuple[str, ...]
    priors: str
    variant: Mapping[str, str] = field(default_factory=dict)
    pool: Mapping[str, str] = field(default_factory=dict)
    n_points: int = 3

    @property
    def name(self) -> str:
        """Files and all that is chosen."""
        chosen = [f"{key}={value}" for key, value in {**self.variant, **self.pool}.items()]
        return " ".join([*self.files, self.priors, *chosen])


CASES = (
    Case(("data/ice/PIL40.toml",), "data/priors/ice.toml"),
    Case(("data/dunite/dunite_4469.toml",), "data/priors/dunite.toml"),
    Case(
        ("data/calibration/ice_rate_steps.toml",),
        "data/priors/ice.toml",
        {"maxwell": "hyperbolic_sine", "residuals": "autocorrelated"},
    ),
    Case(("data/olivine/olivine_twin.toml",), "data/priors/olivine.toml"),
    Case(("data/calibration/olivine_removed.toml",), "data/priors/olivine.toml"),
    Case(
        ("data/calibration/olivine_uncertain_strain.toml",), "data/priors/calibration/olivine.toml"
    ),
    Case(("data/calibration/ice_creep.toml",), "data/priors/ice.toml", {"kelvin": "two_elements"}),
    Case(("data/calibration/ice_mixed.toml",), "data/priors/ice.toml", {"kelvin": "power_law"}),
    Case(("data/halite/halite_z3.toml",), "data/priors/halite.toml"),
    Case(("data/halite/halite_z3.toml",), "data/priors/hardening/halite.toml"),
    Case(
        ("data/calibration/ice_creep.toml",),
        "data/priors/ice.toml",
        {"kelvin": "extended_peak"},
        n_points=1,
    ),
    Case(("tests/baseline/inputs/unload_and_hold.toml",), "data/priors/ice.toml"),
    Case(("data/ice/attenuation_twin.toml",), "data/priors/attenuation/ice.toml"),
    Case(
        ("data/olivine/attenuation_A1802.toml",),
        "data/priors/attenuation/olivine.toml",
        {"kelvin": "extended_peak"},
    ),
    Case(
        ("data/olivine/attenuation_A1906.toml",),
        "data/priors/attenuation/olivine.toml",
        {"kelvin": "andrade"},
    ),
    Case(
        ("data/ice/PIL40.toml", "data/ice/PIL72.toml"),
        "data/priors/ice.toml",
        pool={"kelvin_viscosity": "partial"},
    ),
    Case(
        ("data/ice/curve_beside_attenuation_twin.toml", "data/ice/attenuation_twin.toml"),
        "data/priors/deformation_and_attenuation/ice.toml",
    ),
    Case(("data/calibration/ice_creep.toml", "data/ice/PIL40.toml"), "data/priors/ice.toml"),
)

HISTORY_TRUTH = {
    "maxwell_modulus": 4.83e9,
    "kelvin_modulus": 0.8e9,
    "kelvin_viscosity": 1.2e11,
    "stress_exponent": 3.78,
    "grain_size_exponent": 0.55,
    "activation_enthalpy": 62.08e3,
    "beta": -7.29e-4,
    "steady_state_grain_size": 100e-6,
    "steady_state_fabric_factor": 0.6,
    "critical_strain_grain_size": 0.05,
    "critical_strain_fabric": 0.15,
}

FITS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "data/ice/PIL40.toml": (
        "data/priors/ice.toml",
        ("maxwell_modulus", "activation_enthalpy", "stress_noise"),
    ),
    "data/calibration/olivine_removed.toml": (
        "data/priors/olivine.toml",
        ("kelvin_modulus", "activation_enthalpy", "stress_noise"),
    ),
    "tests/baseline/inputs/unload_and_hold.toml": (
        "data/priors/ice.toml",
        ("kelvin_modulus", "activation_enthalpy", "stress_noise", "strain_noise"),
    ),
    "data/ice/attenuation_twin.toml": (
        "data/priors/attenuation/ice.toml",
        ("kelvin_modulus", "activation_enthalpy", "attenuation_scatter"),
    ),
}
"""Of each kind a test, its priors, and what is inferred: all else is known."""

TRUTH_OF = {
    "data/calibration/olivine_removed.toml": "data/olivine/olivine_twin.toml",
}
"""The file with the truth where it is not in the one of the test."""

SHORT_RUN = SamplerOptions(chains=2, warmup=150, draws=100, seed=11, adapt_delta=0.8)

MAX_Z_SCORE = 5.0
"""Largest distance of two means over its Monte Carlo error."""

MAX_SPREAD_RATIO = 1.8
"""Of two 90 % intervals from 200 draws each, which correlate. Standard deviations of a correlation
time, whose tail is long, differ more between such fits."""


def stored_value(file: str, key: str, found: Any) -> Any:
    """Return what is stored under a key, after `found` was stored there where that is asked for."""
    path = HERE / file
    stored = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if IS_WRITTEN:
        stored[key] = found
        path.write_text(json.dumps(stored, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return stored[key]


def problem_and_data(case: Case, tolerance: float) -> tuple[Problem, StanData]:
    """Tests of a case with their priors, and the data of their program."""
    tests = [load_experiment(REPOSITORY / name) for name in case.files]
    priors = with_variant(load_priors(REPOSITORY / case.priors), tests[0], case.variant)
    problem = problem_of(tests, priors, pooling_for(tests, case.pool))
    return problem, program_data(problem, solver=SolverOptions(tolerance, 1_000_000, method="bdf"))


def points_of(data: StanData) -> FloatArray:
    """Three points in the coordinates of a program, shape (3, n_coordinates), from a seed."""
    rng = np.random.default_rng([3, data["n_coordinates"]])
    return 0.3 * rng.standard_normal((3, data["n_coordinates"]))


def evaluations(case: Case, folder: Path, tolerance: float) -> list[dict[str, FloatArray]]:
    """Log density, gradient and log likelihoods at the points of a case."""
    problem, data = problem_and_data(case, tolerance)
    program = program_with(problem.likelihood.program, data, folder)
    found = []
    for point in points_of(data)[: case.n_points]:
        here = program.at({"coordinate": point.tolist()})
        log_lik = [v for name, v in here.columns.items() if name.split(".")[0] == "log_lik"]
        found.append(
            {
                "log_density": np.array([here.log_density]),
                "gradient": here.gradient,
                "log_lik": np.array([*log_lik[:: 1 + len(log_lik) // 20], sum(log_lik)]),
            }
        )
    return found


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_densities_are_the_stored_ones(case: Case, tmp_path: Path) -> None:
    found = evaluations(case, tmp_path, TOLERANCE)
    record: Any = None
    if IS_WRITTEN:
        tighter = evaluations(case, tmp_path, TIGHTER_TOLERANCE)
        record = [
            {
                name: {
                    "values": values.tolist(),
                    "solver_noise": float(np.abs(values - other[name]).max()),
                }
                for name, values in one.items()
            }
            for one, other in zip(found, tighter, strict=True)
        ]
    stored = stored_value("densities.json", case.name, record)
    for one, point in zip(found, stored, strict=True):
        for name, values in one.items():
            expected = np.array(point[name]["values"])
            limit = GRADIENT_LIMIT if name == "gradient" else RELATIVE_LIMIT
            noise = SOLVER_NOISE_MARGIN * point[name]["solver_noise"]
            np.testing.assert_allclose(
                values, expected, rtol=0, atol=limit * np.abs(expected).max() + noise, err_msg=name
            )


@pytest.fixture(scope="module")
def short_fits(programs: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    """Fits of `FITS`; a few seconds each."""
    folder = tmp_path_factory.mktemp("baseline")
    found = {}
    for name, (priors_file, free) in FITS.items():
        experiment = load_experiment(REPOSITORY / name)
        truth = load_experiment(REPOSITORY / TRUTH_OF.get(name, name)).true_parameters
        priors = load_priors(REPOSITORY / priors_file)
        known = {
            parameter: value
            for parameter, value in (truth or HISTORY_TRUTH).items()
            if parameter not in free and parameter in priors.free
        }
        found[name] = fit(
            experiment,
            with_fixed(priors, known),
            out=folder / experiment.id,
            options=SHORT_RUN,
            command=f"pyburgers fit {name}",
        )
    return found


def hash_of_draws(fitted: Fit) -> str:
    """Hash of all draws of the parameters."""
    draws = fitted.posterior["posterior"].to_dataset().to_array().to_numpy()
    return hashlib.sha256(np.ascontiguousarray(draws).tobytes()).hexdigest()


def summary_record(fitted: Fit) -> dict[str, dict[str, float]]:
    """Mean, spread, Monte Carlo error and width of the 90 % interval of what was inferred."""
    table = fitted.summary("SI")
    table["width"] = table["q95"] - table["q5"]
    columns = ["mean", "sd", "ess_bulk", "width"]
    table = table[table["sd"] > 0]
    return {str(name): {c: float(row[c]) for c in columns} for name, row in table.iterrows()}


@pytest.mark.parametrize("name", FITS)
def test_short_fits_are_the_stored_ones(
    name: str, short_fits: Mapping[str, Fit], record_property: RecordProperty
) -> None:
    fitted = short_fits[name]
    found: dict[str, Any] = {"draws": hash_of_draws(fitted), "summary": summary_record(fitted)}
    stored = stored_value("fits.json", name, found)
    is_identical = stored["draws"] == found["draws"]
    record_property("draws equal bit by bit", is_identical)
    assert found["summary"].keys() == stored["summary"].keys()
    for parameter, expected in stored["summary"].items():
        one = found["summary"][parameter]
        if is_identical:
            assert one == pytest.approx(expected, rel=1e-12)
            continue
        error = np.hypot(*(each["sd"] / np.sqrt(each["ess_bulk"]) for each in (one, expected)))
        assert abs(one["mean"] - expected["mean"]) < MAX_Z_SCORE * error, parameter
        assert 1 / MAX_SPREAD_RATIO < one["width"] / expected["width"] < MAX_SPREAD_RATIO, parameter


def words_on_page(fits: Sequence[Fit], folder: Path) -> list[str]:
    """Text and numbers of a page about fits, without paths, times and versions."""
    page = write_report(fits, folder / "page", title="Baseline", command="pyburgers report RUNS")
    read = Page(page.read_text(encoding="utf-8"))
    text = [*(" ".join(words.split()) for words in read.words), *read.alternatives, *read.labels]
    return [without_origin(words) for words in text if words.strip()]


ORIGINS = (
    (r"(?<![\w.])/\S+/", "PATH/"),
    (r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d)?(\+00:00| UTC)?)?", "TIME"),
    (r"^[\d.]+ (s|min|h)$", "DURATION"),
    (r"\b\d+(\.\d+){2,}\S*", "VERSION"),
    (r"\b[0-9a-f]{12,}\b", "HASH"),
)


def without_origin(text: str) -> str:
    """Replace what differs between two machines or days."""
    for pattern, name in ORIGINS:
        text = re.sub(pattern, name, text)
    return text


def test_page_about_made_up_draws_is_the_stored_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sketch_pictures(monkeypatch)
    fits = [
        make_fit(tmp_path / "A", name="A", chains=2, draws=300),
        make_fit(
            tmp_path / "B",
            name="B",
            kind="measured",
            chains=2,
            draws=300,
            segments=((0.0, 1e-4), (0.05, 1e-5)),
            divergences=5,
            apart=3.0,
        ),
        make_olivine_fit(tmp_path / "C", chains=2, draws=300),
    ]
    found = words_on_page(fits, tmp_path)
    assert found == stored_value("page.json", "made-up draws", found)


def test_page_about_short_fits_is_the_stored_one(
    short_fits: Mapping[str, Fit], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sketch_pictures(monkeypatch)
    hashes = [hash_of_draws(one) for one in short_fits.values()]
    found = {"draws": hashes, "words": words_on_page(list(short_fits.values()), tmp_path)}
    stored = stored_value("page.json", "short fits", found)
    if hashes == stored["draws"]:
        assert found["words"] == stored["words"]
