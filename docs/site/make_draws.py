"""Writes the draws that the page with sliders shows: ``beside/explorer/draws.js``.

    python docs/site/make_draws.py

Fits a synthetic ice test and a digitised dunite test with fixed seeds, which takes minutes, and
keeps some draws of each. Run it again when the model or the priors change.
"""

import argparse
import json
import logging
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import pyburgers
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment

HERE = Path(__file__).parent
DATA = HERE.parents[1] / "data"
TESTS = ("ice/PIL40.toml", "dunite/dunite_4506.toml")
OUTPUT = HERE / "beside" / "explorer" / "draws.js"
KEPT = 60
PARAMETERS = (
    "maxwell_modulus",
    "kelvin_modulus",
    "kelvin_viscosity",
    "stress_exponent",
    "grain_size_exponent",
    "activation_enthalpy",
    "beta",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_grain_size",
    "critical_strain_fabric",
)
OPTIONS = pyburgers.SamplerOptions(chains=4, draws=500, seed=20)


def main() -> None:
    """Fit, and write the draws."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, help="folder for the runs (default: a temporary one)")
    given = parser.parse_args()
    logging.basicConfig(format="%(message)s")
    logging.getLogger("pyburgers").setLevel(logging.INFO)
    with tempfile.TemporaryDirectory() as temporary:
        runs = given.runs or Path(temporary)
        sets = [_set(DATA / test, runs) for test in TESTS]
    text = json.dumps(sets, indent=1)
    OUTPUT.write_text(
        "// Written by docs/site/make_draws.py; change that script, not this file.\n"
        f'"use strict";\nconst DRAWS = {text};\n'
        'if (typeof module !== "undefined") module.exports = { DRAWS };\n',
        encoding="utf-8",
    )


def _set(path: Path, runs: Path) -> dict[str, Any]:
    """Fit a test; return what the page needs of it, in SI units."""
    experiment = pyburgers.load_experiment(path)
    assert isinstance(experiment, ConstantRateExperiment)
    priors = pyburgers.priors(experiment.material)
    fit = pyburgers.fit(experiment, priors, out=runs / experiment.id, options=OPTIONS)
    draws = fit.posterior["posterior"].to_dataset().stack(sample=("chain", "draw"))
    chosen = np.linspace(0, draws.sizes["sample"] - 1, KEPT).round().astype(int)
    return {
        "id": experiment.id,
        "material": experiment.material,
        "kind": experiment.provenance.kind,
        "source": experiment.provenance.source,
        "verdicts": [verdict.sentence for verdict in fit.verdicts().values()],
        "temperature": experiment.temperature,
        "initial_grain_size": experiment.initial_grain_size,
        "strain_rate": experiment.segments[0].strain_rate,
        "final_strain": experiment.final_strain,
        "readings": {
            "strain": [float(f"{value:.6g}") for value in experiment.strain],
            "stress": [float(f"{value:.5g}") for value in experiment.stress],
        },
        "draws": {
            name: [float(f"{value:.8g}") for value in draws[name].to_numpy()[chosen]]
            for name in PARAMETERS
        },
    }


if __name__ == "__main__":
    main()
