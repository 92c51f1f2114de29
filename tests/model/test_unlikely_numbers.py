"""Unlikely numbers of parameters in a material are told; those that are shipped are likely."""

from dataclasses import replace
from pathlib import Path

import pytest

import pyburgers
from pyburgers.common.paths import shipped_folder
from pyburgers.model.prior_families import Prior, PriorTable
from pyburgers.model.priors import PriorSet, load_priors, shipped_prior_files, with_flow_law
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


@pytest.mark.parametrize(
    ("name", "stated", "words"),
    [
        ("beta", pyburgers.normal(-7e-4, 1e-2, "mol/J"), "gives 47% to positive values"),
        ("beta", pyburgers.uniform(-1e-2, 9e-3, "mol/J"), "gives 47% to positive values"),
        ("activation_enthalpy", pyburgers.normal(65, 2000, "kJ/mol"), "not positive"),
        ("activation_enthalpy", pyburgers.fixed(0, "kJ/mol"), "gives 100% to values"),
        ("critical_strain_fabric", pyburgers.uniform(1, 50, "fraction"), "check its unit"),
        ("stress_noise", pyburgers.half_normal(5, "max_stress"), "3.4 times the largest stress"),
    ],
)
def test_priors_against_the_model_are_told(name: str, stated: PriorTable, words: str) -> None:
    (said,) = unlikely_priors(pyburgers.priors("ice").with_(**{name: stated}))
    assert said.startswith(f"{name}: ")
    assert words in said


def test_priors_of_another_material_are_told() -> None:
    ice = pyburgers.priors("ice")
    assert unlikely_priors(ice, "ice") == []
    (said,) = unlikely_priors(ice, "olivine")
    assert said.endswith("are priors of ice, the data are of olivine.")


def test_a_flow_law_is_compared_too() -> None:
    law = pyburgers.priors("halite").flow_law
    assert law is not None
    far = replace(law, mean=law.mean * [1.0, 1.0, 40.0, 1.0])
    halite = with_flow_law(pyburgers.priors("halite"), far, "here")
    assert any(one.startswith("activation_enthalpy: ") for one in unlikely_priors(halite))


RATE_LAWS = sorted((shipped_folder("data") / "priors" / "rates").glob("*.toml"))


@pytest.mark.parametrize("file", RATE_LAWS, ids=lambda file: file.stem)
def test_shipped_rate_laws_are_likely(file: Path) -> None:
    assert unlikely_priors(pyburgers.load_rate_law(file).priors) == []


def test_numbers_of_an_unknown_material_cannot_be_doubted() -> None:
    assert unlikely_numbers("../ice", {"activation_enthalpy": (60.0, 70.0)}) == []
    assert unlikely_numbers("*", {"activation_enthalpy": (60.0, 70.0)}) == []
    assert len(unlikely_numbers("ice", {"activation_enthalpy": (60.0, 70.0)})) == 1
