"""Prior files: the tables of the paper with their corrections, and what is refused."""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from refusals import refusal
from scipy import stats
from small_inputs import DATA

from pyburgers.common.errors import InputError
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.likelihood import NAMES
from pyburgers.model.parameters import PARAMETERS, PIEZOMETER
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import (
    default_priors,
    load_priors,
    save_priors,
    shipped_prior_files,
)
from pyburgers.model.variants import with_variant

CHECKOUT = Path(__file__).parents[2]
GAS_CONSTANT = 8.314462618
MATERIALS = tuple(shipped_prior_files())
WITH_PIEZOMETER = ("dunite", "olivine")

# Tables 1 and 2 in SI as model.md reads them: family and its two numbers.
TABLES = {
    "ice": {
        "kelvin_viscosity": ("uniform", 1e9, 5e11),
        "kelvin_modulus": ("uniform", 5e8, 1e10),
        "maxwell_modulus": ("normal", 4e9, 2e9),
        "steady_state_grain_size": ("uniform", 10e-6, 200e-6),
        "steady_state_fabric_factor": ("uniform", 0.1, 0.9),
        "critical_strain_grain_size": ("uniform", 0.01, 0.1),
        "critical_strain_fabric": ("uniform", 0.01, 0.5),
        "grain_size_exponent": ("uniform", 0.1, 0.7),
        "stress_exponent": ("uniform", 2.7, 4.5),
        "activation_enthalpy": ("normal", 65e3, 2e3),
        "beta": ("normal", -7.29e-4, 1e-6),
    },
    "olivine": {
        "kelvin_viscosity": ("uniform", 5e8, 1e12),
        "kelvin_modulus": ("uniform", 7e8, 9e10),
        "maxwell_modulus": ("normal", 200e9, 10e9),
        "critical_strain_grain_size": ("uniform", 1e-3, 1.0),
        "grain_size_exponent": ("uniform", 0.2, 1.5),
        "stress_exponent": ("uniform", 2.5, 3.9),
        "activation_enthalpy": ("normal", 445e3, 20e3),
        "beta": ("normal", -8.6e-5, 1e-5),
    },
}

Edit = Callable[..., Path]


@pytest.fixture
def edit(tmp_path: Path) -> Edit:
    """Write the ice priors with one parameter's table replaced."""

    def edit(parameter: str, table: str | None, replacement: tuple[str, str] = ("", "")) -> Path:
        text = (CHECKOUT / "data" / "priors" / "ice.toml").read_text(encoding="utf-8")
        start = text.index(f"[parameters.{parameter}]")
        end = text.find("[parameters.", start + 1)
        new = "" if table is None else f'[parameters.{parameter}]\nsource = "test"\n{table}\n\n'
        text = text[:start] + new + (text[end:] if end > 0 else "")
        path = tmp_path / "priors.toml"
        path.write_text(text.replace(*replacement), encoding="utf-8")
        return path

    return edit


class TestShipped:
    @pytest.mark.parametrize("material", MATERIALS)
    def test_every_parameter_has_a_prior_with_a_source(self, material: str) -> None:
        priors = default_priors(material)
        assert priors.material == material
        names = [parameter.name for parameter in PARAMETERS]
        piezometer = PIEZOMETER if material in WITH_PIEZOMETER else ()
        assert list(priors.priors) == [*names, *piezometer]
        assert all(prior.source for prior in priors.priors.values())

    @pytest.mark.parametrize(
        ("material", "name"), [(material, name) for material in TABLES for name in TABLES[material]]
    )
    def test_tables_of_the_paper(self, material: str, name: str) -> None:
        family, *numbers = TABLES[material][name]
        prior = default_priors(material)[name]
        assert prior.family == family
        found = (prior.lower, prior.upper) if family == "uniform" else (prior.location, prior.scale)
        assert found == pytest.approx(tuple(numbers), rel=1e-12)

    def test_sign_of_beta_gives_laboratory_rates(self) -> None:
        # Misprint 1: ice flows at about 1e-4 1/s at 8 MPa, here with n, p, Q of the twin of PIL40.
        beta = default_priors("ice")["beta"].location

        def rate(sign: float) -> float:
            exponent = 62.08e3 * (sign * beta - 1 / (GAS_CONSTANT * 260.0))
            return float((8e6) ** 3.779 * (230e-6) ** -0.55 * math.exp(exponent))

        assert 1e-5 < rate(1.0) < 1e-3
        assert 1e34 < rate(-1.0) < 1e36

    def test_spread_is_a_standard_deviation(self) -> None:
        # Misprint 2: Hansen et al. 2011 report Q = 445 +/- 20 kJ/mol.
        enthalpy = default_priors("olivine")["activation_enthalpy"].distribution()
        assert enthalpy.std() == pytest.approx(20e3, rel=1e-6)

    def test_units_are_pascal_and_metre(self) -> None:
        # Misprint 3: the flow law of Hansen et al. 2011 in SI falls inside the prior of beta.
        log_a = math.log(10**4.8) - 2.9 * math.log(1e6) + 0.73 * math.log(1e-6)
        beta = default_priors("olivine")["beta"]
        assert log_a / 445e3 == pytest.approx(-8.79e-5, rel=1e-3)
        assert abs(log_a / 445e3 - beta.location) < beta.scale

    def test_olivine_has_no_fabric(self) -> None:
        priors = default_priors("olivine")
        assert priors["steady_state_fabric_factor"].is_fixed
        assert priors["steady_state_fabric_factor"].location == 1
        assert "critical_strain_fabric" not in priors.free
        grain_size = priors["steady_state_grain_size"]
        assert grain_size.is_fixed
        assert grain_size.location == pytest.approx(0.015 * 100**-1.33, rel=1e-3)

    @pytest.mark.parametrize(
        ("temperature", "rate", "stress"), [(1573.0, 1.07e-4, 370e6), (1553.0, 1.2e-4, 480e6)]
    )
    def test_dunite_flows_at_the_measured_stress(
        self, temperature: float, rate: float, stress: float
    ) -> None:
        # The measured flow stress lies well inside what the prior predicts.
        priors = default_priors("dunite")
        rng = np.random.default_rng(1)
        n, p, enthalpy, beta = (
            priors[name].distribution().rvs(2000, random_state=rng)
            for name in ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")
        )
        arrhenius = enthalpy * (beta - 1 / (GAS_CONSTANT * temperature))
        log_stress = (np.log(rate) + p * np.log(0.9e-3) - arrhenius) / n
        assert 0.2 < np.mean(log_stress < np.log(stress)) < 0.8

    def test_unknown_material_lists_what_there_is(self) -> None:
        with pytest.raises(InputError, match=rf"'granite'.*{', '.join(MATERIALS)}"):
            default_priors("granite")

    def test_every_kind_of_test_has_priors(self) -> None:
        usual = default_priors("ice")
        others = {kind: default_priors("ice", kind) != usual for kind in NAMES}
        assert others == {kind: kind == "attenuation" for kind in NAMES}

    @pytest.mark.parametrize(
        ("protocol", "end"),
        [
            ("constant_rates", "did you mean 'constant_rate'"),
            ("x", f"one of {', '.join(sorted(NAMES))}"),
        ],
    )
    def test_a_kind_of_test_that_is_none_is_refused(self, protocol: str, end: str) -> None:
        with pytest.raises(InputError, match=rf"protocol '{protocol}' does not exist, .*{end}"):
            default_priors("ice", protocol)


class TestDistributions:
    @pytest.mark.parametrize(
        ("table", "expected"),
        [
            ('family = "uniform"\nlower = 1\nupper = 3\nunit = "GPa"', stats.uniform(1e9, 2e9)),
            (
                'family = "normal"\nlocation = 4\nscale = 2\nlower = 0\nunit = "GPa"',
                stats.truncnorm(-2, np.inf, loc=4e9, scale=2e9),
            ),
            ('family = "half_normal"\nscale = 2\nunit = "GPa"', stats.halfnorm(scale=2e9)),
            (
                'family = "lognormal"\nlocation = 2\nscale = 0.5\nunit = "GPa"',
                stats.lognorm(s=0.5, scale=2e9),
            ),
        ],
    )
    def test_families(self, edit: Edit, table: str, expected: "stats.rv_continuous") -> None:
        prior = load_priors(edit("maxwell_modulus", table))["maxwell_modulus"]
        shares = np.array([0.01, 0.3, 0.5, 0.99])
        np.testing.assert_allclose(
            prior.distribution().ppf(shares), expected.ppf(shares), rtol=1e-9
        )
        draws = [prior.sample(np.random.default_rng(seed)) for seed in range(200)]
        assert stats.kstest(draws, expected.cdf).pvalue > 1e-3
        assert min(draws) >= prior.lower

    def test_a_fixed_parameter_gives_its_value(self, edit: Edit) -> None:
        path = edit("stress_exponent", 'family = "fixed"\nvalue = 4\nunit = "1"')
        priors = load_priors(path)
        prior = priors["stress_exponent"]
        assert prior.is_fixed
        assert prior.sample(np.random.default_rng(0)) == 4.0
        assert "stress_exponent" not in priors.free
        assert len(priors.free) == len(PARAMETERS) - 1
        with pytest.raises(InputError, match="fixed"):
            prior.distribution()

    def test_noise_relative_to_the_largest_stress(self) -> None:
        priors = default_priors("ice")
        assert priors["stress_noise"].relative_to_max_stress
        with pytest.raises(InputError, match="resolved"):
            priors["stress_noise"].distribution()
        resolved = priors.resolved(8e6)
        assert resolved["stress_noise"].scale == pytest.approx(0.4e6)
        assert not resolved["stress_noise"].relative_to_max_stress
        assert resolved["beta"] == priors["beta"]


class TestSaving:
    @pytest.mark.parametrize("material", MATERIALS)
    def test_a_copy_reads_back_equal(self, material: str, tmp_path: Path) -> None:
        priors = default_priors(material)
        for version in (priors, priors.resolved(12.3456789e6)):
            save_priors(version, tmp_path / "copy.toml")
            assert load_priors(tmp_path / "copy.toml") == version


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda rows: [rows[0][:3], *rows[1:]], "whose rows differ in length"),
        (lambda rows: rows[:3], "expected (4,) and (4, 4)"),
        (lambda rows: [[1e308] * 4] * 4, "not symmetric and positive definite"),
    ],
)
def test_a_wrong_covariance_of_the_flow_law_is_refused(
    change: Callable[[list[list[float]]], object], expected: str, tmp_path: Path
) -> None:
    table = tomllib.loads(shipped_prior_files()["halite"].read_text(encoding="utf-8"))
    table["flow_law"]["covariance"] = change(table["flow_law"]["covariance"])
    path = tmp_path / "halite.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    assert expected in refusal(path, load_priors)


def test_a_flow_law_of_a_file_replaces_the_single_priors(tmp_path: Path) -> None:
    table = tomllib.loads(shipped_prior_files()["ice"].read_text(encoding="utf-8"))
    halite = tomllib.loads(shipped_prior_files()["halite"].read_text(encoding="utf-8"))
    law, path = halite["flow_law"], tmp_path / "ice.toml"
    table["flow_law"] = law
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    priors = load_priors(path)
    assert priors.title == table["title"]
    exponent = priors["stress_exponent"]
    assert (exponent.family, exponent.location) == ("normal", law["mean"][0])
    law["mean"][3] = -law["mean"][3]
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    assert "the mean of beta: key 'location'" in refusal(path, load_priors)
    law["mean"][3] = -law["mean"][3]
    fixed = {"family": "fixed", "value": 3.0, "unit": "1", "source": "mine"}
    table["parameters"]["stress_exponent"] = fixed
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    assert "[flow_law]: stress_exponent is fixed" in refusal(path, load_priors)


def test_only_ice_has_the_misprint_of_beta(tmp_path: Path) -> None:
    table = tomllib.loads(shipped_prior_files()["olivine"].read_text(encoding="utf-8"))
    table["parameters"]["beta"]["location"] *= -1
    path = tmp_path / "olivine.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    said = refusal(path, load_priors)
    assert "7.29e-4" not in said
    assert "A of a power law is far below 1" in said


def test_priors_compare_by_value_whatever_the_unit_written() -> None:
    one, other = (
        Prior("stress_exponent", "uniform", 3.0, 1.0, 2.0, 4.0, unit, "somebody")
        for unit in ("1", "dimensionless")
    )
    assert one == other


def test_tables_of_what_a_variant_takes_out_may_be_missing(tmp_path: Path) -> None:
    text = (DATA / "priors" / "ice.toml").read_text(encoding="utf-8")
    tables = text.split("[parameters.")
    fabric = ("steady_state_fabric_factor]", "critical_strain_fabric]")
    path = tmp_path / "ice.toml"
    path.write_text(
        "[parameters.".join(table for table in tables if not table.startswith(fabric)),
        encoding="utf-8",
    )
    with pytest.raises(InputError, match=r"fabric=constant, which takes it out") as caught:
        load_priors(path)
    assert len(caught.value.sentences) == 2
    choices = {"fabric": "constant"}
    experiment = load_experiment(DATA / "ice" / "PIL40.toml")
    without = with_variant(load_priors(path, choices), experiment, choices)
    complete = with_variant(load_priors(DATA / "priors" / "ice.toml"), experiment, choices)
    assert {name: prior.location for name, prior in without.priors.items()} == {
        name: prior.location for name, prior in complete.priors.items()
    }
    assert without.free == complete.free
    with pytest.raises(InputError, match="steady_state_fabric_factor"):
        load_priors(path, {"grain_size": "constant"})
