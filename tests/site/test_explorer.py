"""The script of the page with sliders gives the numbers of the library.

Needs node (Debian and Ubuntu: ``apt-get install nodejs``); run with ``pytest -m node``.
"""

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import DUNITE, ICE

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import simulate
from pyburgers.predictions.attenuation import attenuation_spectrum
from pyburgers.predictions.stress_cycles import Regime

EXPLORER = Path(__file__).parents[2] / "docs" / "site" / "beside" / "explorer"

pytestmark = pytest.mark.node

FREQUENCIES = np.geomspace(1e-4, 1.0, 30)
REGIMES = (Regime(1e6, 0.17e6), Regime(0.2e6, 1e6), Regime(20e6, 5e6))
FILES = {"PIL40": ICE / "PIL40.toml", "dunite_4506": DUNITE / "dunite_4506.toml"}


def in_node(expression: str, **given: object) -> Any:
    """Return the value of a JavaScript expression that uses the model and the draws."""
    names = ", ".join(given)
    script = (
        f"const model = require({json.dumps(str(EXPLORER / 'burgers.js'))});"
        f"const {{ DRAWS }} = require({json.dumps(str(EXPLORER / 'draws.js'))});"
        f"const {{ {names} }} = JSON.parse(require('fs').readFileSync(0, 'utf8'));"
        f"process.stdout.write(JSON.stringify({expression}));"
    )
    ended = subprocess.run(
        ["node", "-e", script], input=json.dumps(given), capture_output=True, text=True, check=True
    )
    return json.loads(ended.stdout)


def shipped() -> dict[str, Any]:
    return {found["id"]: found for found in in_node("DRAWS", nothing=0)}


def draws_of(found: dict[str, Any], which: slice) -> list[dict[str, float]]:
    columns = found["draws"]
    return [
        dict(zip(columns, values, strict=True))
        for values in zip(*(column[which] for column in columns.values()), strict=True)
    ]


@pytest.mark.parametrize("test", FILES)
@pytest.mark.parametrize("regime", REGIMES, ids=lambda regime: regime.label)
def test_attenuation_is_that_of_the_library(test: str, regime: Regime) -> None:
    found = shipped()[test]
    draws = draws_of(found, slice(None))
    for temperature, size, fabric in (
        (found["temperature"], 1e-4, 1.0),
        (1.03 * found["temperature"], 2e-3, 0.6),
    ):
        computed = in_node(
            "draws.map((p) => model.tanDelta(p, frequencies, regime, temperature, size, fabric))",
            draws=draws,
            frequencies=FREQUENCIES.tolist(),
            regime={"median": regime.median_stress, "amplitude": regime.amplitude},
            temperature=temperature,
            size=size,
            fabric=fabric,
        )
        expected = attenuation_spectrum(
            {name: [draw[name] for draw in draws] for name in draws[0]},
            FREQUENCIES,
            [regime],
            temperature=temperature,
            grain_size=size,
            fabric_factor=fabric,
        )["tan_delta"].isel(regime=0)
        np.testing.assert_allclose(computed, expected, rtol=1e-9)


@pytest.mark.parametrize("test", FILES)
@pytest.mark.parametrize("tolerance", [1e-7, 1e-4], ids=["tight", "as on the page"])
def test_curves_are_those_of_the_library(programs: None, test: str, tolerance: float) -> None:
    found = shipped()[test]
    draws = draws_of(found, slice(0, None, 12))
    experiment = load_constant_rate(FILES[test])
    for factor, temperature, size in ((1.0, 1.0, 1.0), (0.05, 0.97, 3.0), (8.0, 1.02, 0.3)):
        changed = at(experiment, factor, temperature, size)
        strains = changed.final_strain * (np.arange(1, 41) / 40) ** 1.5
        computed = in_node(
            "draws.map((p) => model.constantRate(p, test, strains, tolerance))",
            draws=draws,
            test={
                "strainRate": changed.segments[0].strain_rate,
                "temperature": changed.temperature,
                "grainSize": changed.initial_grain_size,
            },
            strains=strains.tolist(),
            tolerance=tolerance,
        )
        for draw, stresses in zip(draws, computed, strict=True):
            solution = simulate(changed, draw, at=strains)
            expected = np.interp(strains, solution["strain"], solution["stress_Pa"])
            largest = np.abs(expected).max()
            # The method is of order 2: a line of the page is a few pixels wide at 1e-3.
            limit = 30 * tolerance if tolerance < 1e-5 else 2e-3
            assert np.abs(np.array(stresses) - expected).max() <= limit * largest


def at(
    experiment: ConstantRateExperiment, factor: float, temperature: float, size: float
) -> ConstantRateExperiment:
    """Return a test at another rate, temperature and grain size."""
    (segment, *_) = experiment.segments
    return replace(
        experiment,
        segments=(RateSegment(0.0, factor * segment.strain_rate),),
        temperature=temperature * experiment.temperature,
        initial_grain_size=size * experiment.initial_grain_size,
    )


def test_draws_are_labelled(tmp_path: Path) -> None:
    """Synthetic data say so, and a reading of the page is one of the file."""
    for name, path in FILES.items():
        found, experiment = shipped()[name], load_constant_rate(path)
        assert found["kind"] == experiment.provenance.kind
        assert found["readings"]["stress"] == pytest.approx(experiment.stress.tolist(), rel=1e-4)
        assert len(found["verdicts"]) == 2


def test_the_slider_of_the_reference_stress_holds_it() -> None:
    found = shipped()["PIL40"]
    (draw,) = draws_of(found, slice(0, 1))
    rate, temperature, size = (
        found[name] for name in ("strain_rate", "temperature", "initial_grain_size")
    )
    given = {"p": draw | {"stress_exponent": 2.7}, "test": [rate, temperature, size]}
    held = in_node(
        "model.referenceStress("
        "{...p, beta: model.betaOfReferenceStress(p, 5e6, ...test)}, ...test)",
        **given,
    )
    assert held == pytest.approx(5e6, rel=1e-12)
