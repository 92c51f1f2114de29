"""Shipped priors that were read off shipped data name these data, and no others."""

from pathlib import Path

import pytest
from conftest import DUNITE

from pyburgers.fitting.sampled_fit import data_words
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.priors import JOINT_PRIOR, load_priors, shipped_prior_file

KELVIN = {"kelvin_modulus", "kelvin_viscosity"}
SALT = DUNITE.parent / "halite" / "halite_z3.toml"


@pytest.mark.parametrize(
    ("material", "folder", "file", "read_off"),
    [
        ("dunite", ".", DUNITE / "dunite_4581.toml", KELVIN),
        ("dunite", ".", DUNITE / "dunite_4506.toml", KELVIN),
        ("dunite", ".", DUNITE / "dunite_4580.toml", set()),
        ("halite", ".", SALT, KELVIN | {"maxwell_modulus", JOINT_PRIOR}),
        ("halite", "hardening", SALT, KELVIN | {"maxwell_modulus", "steady_state_fabric_factor"}),
    ],
)
def test_priors_name_the_data_that_they_were_read_off(
    material: str, folder: str, file: Path, read_off: set[str]
) -> None:
    priors = load_priors(shipped_prior_file(material, folder))
    test = load_experiment(file)
    assert priors.read_off([data_words("renamed", test.provenance)]) == read_off
