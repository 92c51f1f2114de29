"""Flow law from peak stresses: least squares, known truths, priors, densities, run directory."""

import json
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import oracle
import pytest
from conftest import ICE, with_fixed
from scipy import stats

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.drawing.style import image
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import (
    PeakStressFit,
    fit_peak_stress,
    flow_law_prior,
    peak_stress_coordinates,
    peak_stress_data,
)
from pyburgers.flow_law_tables.inputs import (
    FLOW_LAW_PARAMETERS,
    PeakStressData,
    default_peak_stress_priors,
    load_peak_stress,
)
from pyburgers.model.flow_law_prior import FLOW_LAW_PRIOR_FILE, FlowLawPrior
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.experiment import Provenance
from pyburgers.report.peak_stress_section import flow_law, flow_law_table
from pyburgers.sampling.options import SamplerOptions

FloatArray = npt.NDArray[np.float64]

OPTIONS = SamplerOptions(chains=2, warmup=400, draws=1000, seed=3)
TRUTH = {
    "stress_exponent": 3.2,
    "grain_size_exponent": 1.1,
    "activation_enthalpy": 62e3,
    "beta": -7e-4,
    "rate_scatter": 0.1,
}


def qi_and_goldsby() -> PeakStressData:
    return load_peak_stress(ICE / "peak_stress_qi_goldsby_2021.toml")


def made_up(n_points: int, *, uncertainty: float = 0.0, seed: int = 1) -> PeakStressData:
    """Tests at wide ranges of temperature, stress and grain size with the scatter of `TRUTH`."""
    rng = np.random.default_rng(seed)
    temperature = rng.uniform(230, 270, n_points)
    stress = np.exp(rng.uniform(np.log(1e6), np.log(2e7), n_points))
    grain_size = np.exp(rng.uniform(np.log(5e-5), np.log(1e-3), n_points))
    log_rate = oracle_log_rate(TRUTH, temperature, stress, grain_size)
    measured = stress * np.exp(uncertainty * rng.normal(size=n_points))
    return PeakStressData(
        id="made-up",
        material="ice",
        temperature=temperature,
        stress=measured,
        strain_rate=np.exp(log_rate + TRUTH["rate_scatter"] * rng.normal(size=n_points)),
        grain_size=grain_size,
        relative_stress_uncertainty=np.full(n_points, uncertainty),
        provenance=Provenance("synthetic", "made up for a test"),
    )


def oracle_log_rate(
    values: dict[str, float], temperature: FloatArray, stress: FloatArray, grain_size: FloatArray
) -> FloatArray:
    """Return ln(strain rate s) by Eq. 1 with F = 1."""
    arrhenius = values["beta"] - 1 / (oracle.GAS_CONSTANT * temperature)
    log_rate: FloatArray = (
        values["stress_exponent"] * np.log(stress)
        - values["grain_size_exponent"] * np.log(grain_size)
        + values["activation_enthalpy"] * arrhenius
    )
    return log_rate


def posterior_draws(fit: PeakStressFit, name: str) -> FloatArray:
    return all_draws(fit.posterior["posterior"].to_dataset()[name])


@pytest.fixture(scope="module")
def ice_fit(tmp_path_factory: pytest.TempPathFactory) -> PeakStressFit:
    out = tmp_path_factory.mktemp("peak_stress") / "run"
    return fit_peak_stress(qi_and_goldsby(), default_peak_stress_priors("ice"), out=out)


def test_the_published_table_gives_the_exponents_of_least_squares(ice_fit: PeakStressFit) -> None:
    data = ice_fit.data
    design = np.column_stack(
        [np.log(data.stress), -np.log(data.grain_size), np.ones(data.n_points)]
    )
    log_rate = np.log(data.strain_rate)
    solution, (residual,), *_ = np.linalg.lstsq(design, log_rate)
    variance = residual / (data.n_points - design.shape[1])
    errors = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    summary = ice_fit.summary()
    for k, name in enumerate(("stress_exponent", "grain_size_exponent")):
        assert summary["mean"][name] == pytest.approx(solution[k], abs=0.1)
        assert summary["sd"][name] == pytest.approx(errors[k], rel=0.2)
    assert summary["mean"]["rate_scatter"] == pytest.approx(np.sqrt(variance), rel=0.2)
    assert all(check.passed for check in ice_fit.checks())


def test_a_single_temperature_leaves_the_activation_enthalpy_open(ice_fit: PeakStressFit) -> None:
    # The level of the rates ties Q_M to beta; beta itself stays as its prior was.
    summary = ice_fit.summary()
    assert summary["sd"]["beta"] > 0.7 * summary["prior_sd"]["beta"]


def test_the_sampled_flow_rate_is_nearly_independent_of_the_exponents(
    ice_fit: PeakStressFit,
) -> None:
    covariance = flow_law_prior(ice_fit).covariance
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    assert np.abs(correlation[2, [0, 1, 3]]).max() < 0.2
    assert float(ice_fit.posterior["sample_stats"]["n_steps"].mean()) < 16


def test_wide_conditions_recover_the_whole_law(tmp_path: Path) -> None:
    fit = fit_peak_stress(
        made_up(60), default_peak_stress_priors("ice"), out=tmp_path / "run", options=OPTIONS
    )
    for name, truth in TRUTH.items():
        draws = posterior_draws(fit, name)
        assert abs(draws.mean() - truth) < 3.3 * draws.std()
    assert posterior_draws(fit, "activation_enthalpy").std() < 1e3


def test_uncertain_stresses_are_no_scatter_of_the_rate(tmp_path: Path) -> None:
    data = made_up(100, uncertainty=0.1, seed=2)
    priors = default_peak_stress_priors("ice")
    short = replace(OPTIONS, warmup=300, draws=300)
    known = fit_peak_stress(data, priors, out=tmp_path / "known", options=short)
    ignored = fit_peak_stress(
        replace(data, relative_stress_uncertainty=np.zeros(100)),
        priors,
        out=tmp_path / "ignored",
        options=short,
    )
    # 10 % of stress are n times as much of the rate.
    total = np.hypot(TRUTH["rate_scatter"], 0.1 * TRUTH["stress_exponent"])
    assert posterior_draws(ignored, "rate_scatter").mean() == pytest.approx(total, rel=0.2)
    assert posterior_draws(known, "rate_scatter").mean() < 0.6 * total


def test_without_likelihood_the_draws_are_the_prior_s(tmp_path: Path) -> None:
    # Each weight is moderate, so that 1/RT - beta stays positive for practically every draw.
    priors = default_peak_stress_priors("ice")
    fit = fit_peak_stress(
        qi_and_goldsby(),
        priors,
        out=tmp_path / "run",
        options=replace(OPTIONS, draws=2500),
        use_likelihood=False,
    )
    for name, prior in priors.priors.items():
        independent = posterior_draws(fit, name)[::5]
        assert stats.kstest(independent, prior.distribution().cdf).pvalue > 1e-3, name


def with_bounded_enthalpy(priors: PriorSet) -> PriorSet:
    """Bounds on both sides keep Q_M a coordinate of its own, so that beta is replaced."""
    name = "activation_enthalpy"
    prior = Prior(name, "uniform", 60e3, 30e3, 30e3, 90e3, "J/mol", "test")
    return replace(priors, priors=MappingProxyType({**priors.priors, name: prior}))


@pytest.mark.parametrize("replaced", ["activation_enthalpy", "beta", None])
def test_density_is_prior_plus_likelihood_plus_jacobian(
    replaced: str | None, tmp_path: Path
) -> None:
    data = replace(qi_and_goldsby(), relative_stress_uncertainty=np.full(23, 0.03))
    priors = default_peak_stress_priors("ice")
    if replaced != "activation_enthalpy":
        priors = with_bounded_enthalpy(priors)
    if replaced is None:
        priors = with_fixed(priors, {"beta": -7.1e-4})
    coordinates = peak_stress_coordinates(data, priors)
    assert coordinates.replaced_parameter == replaced
    model = load_program(stan_directory() / "peak_stress.stan")
    stan_data = peak_stress_data(data, priors)

    def at(coordinate: FloatArray) -> dict[str, FloatArray]:
        return model.evaluate(stan_data, {"coordinate": coordinate.tolist()})

    centre = np.random.default_rng(5).normal(0.0, 0.3, len(coordinates.quantities))
    found = at(centre)
    values = {p.name: float(found[p.name]) for p in FLOW_LAW_PARAMETERS}
    log_prior = sum(float(priors[name].distribution().logpdf(values[name])) for name in priors.free)
    assert float(found["lprior"]) == pytest.approx(log_prior, rel=1e-9)
    mean = oracle_log_rate(values, data.temperature, data.stress, data.grain_size)
    deviation = np.hypot(values["rate_scatter"], 0.03 * values["stress_exponent"])
    np.testing.assert_allclose(
        found["log_lik"], stats.norm.logpdf(np.log(data.strain_rate), mean, deviation), rtol=1e-9
    )
    step = 1e-4
    jacobian = []
    for shift in step * np.eye(centre.size):
        above, below = at(centre + shift), at(centre - shift)
        jacobian.append([float(above[k] - below[k]) / (2 * step) for k in priors.free])
    _, log_determinant = np.linalg.slogdet(np.array(jacobian))
    assert float(found["log_jacobian"]) == pytest.approx(log_determinant, abs=1e-5)


def test_predictions_lie_on_the_law(ice_fit: PeakStressFit) -> None:
    predictions = ice_fit.posterior["predictions"].to_dataset()
    rate = all_draws(predictions["strain_rate"])
    stress = predictions["stress"].to_numpy()
    slope = np.log(rate[..., -1] / rate[..., 0]) / np.log(stress[:, -1] / stress[:, 0])
    exponent = posterior_draws(ice_fit, "stress_exponent")
    np.testing.assert_allclose(slope, np.broadcast_to(exponent[:, None], slope.shape), rtol=1e-5)


def test_a_run_is_read_back_and_continued_without_sampling(
    ice_fit: PeakStressFit, capsys: pytest.CaptureFixture[str]
) -> None:
    path = ice_fit.directory.path
    loaded = PeakStressFit.load(path)
    assert loaded.priors == ice_fit.priors
    assert loaded.summary().equals(ice_fit.summary())
    before = {chain: record["sha256"] for chain, record in ice_fit.manifest["chains"].items()}
    capsys.readouterr()
    again = fit_peak_stress(ice_fit.data, ice_fit.priors, out=path)
    assert {k: record["sha256"] for k, record in again.manifest["chains"].items()} == before
    assert "iterations" not in capsys.readouterr().err
    assert again.manifest["status"] == "complete"
    assert {"inputs/peak_stress.toml", "inputs/peak_stress.csv", "inputs/priors.toml"} <= set(
        again.manifest["hashes"]
    )
    checks = json.loads(again.directory.checks_file.read_text(encoding="utf-8"))["checks"]
    assert all(check["passed"] for check in checks)


def test_other_inputs_and_other_runs_are_refused(ice_fit: PeakStressFit, small_fit: Fit) -> None:
    path = ice_fit.directory.path
    with pytest.raises(InputError, match="holds a run of other inputs"):
        fit_peak_stress(made_up(10), ice_fit.priors, out=path)
    with pytest.raises(InputError, match="is not a fit of a table of peak stresses"):
        PeakStressFit.load(small_fit.directory.path)


def test_the_flow_law_is_handed_on_as_json(ice_fit: PeakStressFit) -> None:
    prior = FlowLawPrior.load(ice_fit.directory.path / FLOW_LAW_PRIOR_FILE)
    assert prior.quantities[2] == "log_reference_flow_rate"
    np.testing.assert_array_equal(prior.mean, flow_law_prior(ice_fit).mean)
    assert prior.mean[0] == pytest.approx(ice_fit.summary()["mean"]["stress_exponent"])
    assert np.sqrt(prior.covariance[1, 1]) == pytest.approx(
        ice_fit.summary()["sd"]["grain_size_exponent"]
    )
    assert prior.conditions == ice_fit.data.mean_conditions
    assert prior.material == "ice"
    assert prior.source.startswith("peak_stress_qi_goldsby_2021: Qi, C. and Goldsby")
    np.linalg.cholesky(prior.covariance)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{", "is not a flow law prior"),
        ('{"mean": [1.0]}', "is not a flow law prior"),
        (
            '{"quantities": ["a", "b"], "mean": [1.0], "covariance": [[1.0]], "conditions": '
            '{"temperature": 1.0, "stress": 1.0, "grain_size": 1.0}, "material": "ice", '
            '"source": "x"}',
            r"found a mean of shape \(1,\)",
        ),
    ],
)
def test_a_file_that_is_no_flow_law_is_refused(tmp_path: Path, content: str, expected: str) -> None:
    path = tmp_path / "prior.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=expected):
        FlowLawPrior.load(path)
    with pytest.raises(InputError, match="cannot be read"):
        FlowLawPrior.load(tmp_path / "nothing.json")


def test_a_fixed_parameter_is_sampled_around_but_not_handed_on(tmp_path: Path) -> None:
    priors = with_fixed(default_peak_stress_priors("ice"), {"grain_size_exponent": 0.6})
    fit = fit_peak_stress(qi_and_goldsby(), priors, out=tmp_path / "run", options=OPTIONS)
    assert "grain_size_exponent" not in fit.summary().index
    assert not (tmp_path / "run" / FLOW_LAW_PRIOR_FILE).exists()
    with pytest.raises(InputError, match=r"grain_size_exponent is fixed, expected .*\.$"):
        flow_law_prior(fit)
    assert flow_law_table(fit)["prior"].tolist()[1] == "fixed"


def test_table_and_figure_show_every_quantity_and_group(ice_fit: PeakStressFit) -> None:
    table = flow_law_table(ice_fit)
    assert table["symbol"].tolist() == ["n", "p", "Q_M", "β", "s_ε̇", "ε̇_0"]
    figure = flow_law(ice_fit)
    (axes,) = figure.axes
    labels = axes.get_legend_handles_labels()[1]
    assert [label for label in labels if label.startswith("tests")] == ["tests (18)", "tests (5)"]
    assert image(figure, "png").startswith(b"\x89PNG")
