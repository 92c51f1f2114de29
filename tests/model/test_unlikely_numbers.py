"""Unlikely numbers of parameters in a material are told; those that are shipped are likely."""

from dataclasses import replace
from pathlib import Path

import pytest

import pyburgers
from pyburgers.common.paths import shipped_folder
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet, load_priors, shipped_prior_files
from pyburgers.model.unlikely_numbers import unlikely_numbers, unlikely_priors


def scaled(prior: Prior, factor: float) -> Prior:
    """Return a prior in a unit that is by a factor too small."""
    return replace(
        prior,
        location=prior.location * factor,
        scale=prior.scale * factor,
        lower=prior.lower * factor,
        upper=prior.upper * factor,
    )


def with_prior(name: str, prior: Prior) -> PriorSet:
    ice = pyburgers.priors("ice")
    return replace(ice, priors={**ice.priors, name: prior})


FILES = sorted(
    file
    for material in shipped_prior_files()
    for file in (shipped_folder("data") / "priors").rglob(f"{material}.toml")
)


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_shipped_priors_are_likely(file: Path) -> None:
    assert unlikely_priors(load_priors(file)) == []


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("activation_enthalpy", 1e-3),
        ("steady_state_grain_size", 1e6),
        ("kelvin_modulus", 1e-3),
        ("maxwell_modulus", 1e3),
        ("activation_enthalpy", 1 / 4.184),
        ("critical_strain_grain_size", 100.0),
        ("beta", 1e-3),
    ],
)
def test_a_prior_in_a_wrong_unit_is_told(name: str, factor: float) -> None:
    (said,) = unlikely_priors(with_prior(name, scaled(pyburgers.priors("ice")[name], factor)))
    assert said.startswith(f"{name}: ")
    assert "check its unit" in said


def test_a_prior_from_another_paper_is_likely() -> None:
    """Goldsby and Kohlstedt's dislocation creep: ln(4e-19)/60e3, and 181 kJ/mol near melting."""
    for name, factor in (("beta", 7.06 / 7.29), ("activation_enthalpy", 181 / 65)):
        usual = pyburgers.priors("ice")[name]
        own = replace(usual, location=factor * usual.location)
        assert unlikely_priors(with_prior(name, own)) == []


def test_a_normal_prior_outside_its_bounds_is_told() -> None:
    usual = pyburgers.priors("ice")["activation_enthalpy"]
    assert usual.family == "normal"
    far = replace(usual, lower=usual.location + 17 * usual.scale)
    said = unlikely_priors(with_prior("activation_enthalpy", far))
    assert any("standard deviations outside its own bounds" in one for one in said)


def test_numbers_of_an_unknown_material_cannot_be_doubted() -> None:
    assert unlikely_numbers("../ice", {"activation_enthalpy": (60.0, 70.0)}) == []
    assert unlikely_numbers("*", {"activation_enthalpy": (60.0, 70.0)}) == []
    assert len(unlikely_numbers("ice", {"activation_enthalpy": (60.0, 70.0)})) == 1
