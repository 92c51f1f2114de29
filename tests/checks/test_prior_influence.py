"""Prior influence: distances against quadrature, conjugate models, a trade-off, a real fit."""

import math
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr
from conftest import SMALL_RUN, write_problem
from scipy import stats
from scipy.integrate import quad
from scipy.special import xlogy

from pyburgers.checks.prior_influence import (
    FAR_OUT,
    POWER_STEP,
    SENSITIVE,
    THRESHOLDS_TEXT,
    Influence,
    conflict_sentence,
    conflicts,
    cumulative_distance,
    influence_table,
    mean_pull,
    power_scaling_sensitivity,
    prior_influence,
)
from pyburgers.fitting.fit import fit
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]
N_DRAWS = 20_000


@dataclass(frozen=True)
class Conjugate:
    """Normal prior N(0, 1) of a mean, and data that amount to one reading of it."""

    reading: float
    deviation: float

    def posterior(self, prior_power: float = 1.0, data_power: float = 1.0) -> tuple[float, float]:
        """Mean and standard deviation with prior and likelihood raised to powers."""
        precision = data_power / self.deviation**2
        total = prior_power + precision
        return precision * self.reading / total, total**-0.5

    def draws(self) -> FloatArray:
        """Quantiles of the posterior, in a random order: no Monte Carlo error."""
        mean, sd = self.posterior()
        quantiles = stats.norm.ppf((np.arange(N_DRAWS) + 0.5) / N_DRAWS)
        return np.random.default_rng(1).permutation(mean + sd * quantiles)

    def log_prior(self, draws: FloatArray) -> FloatArray:
        return np.asarray(stats.norm.logpdf(draws))

    def log_likelihood(self, draws: FloatArray) -> FloatArray:
        return np.asarray(stats.norm.logpdf(self.reading, draws, self.deviation))


def exact_distance(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Cumulative Jensen-Shannon distance of two normals by quadrature, the larger direction.

    Over the range that the draws cover: towards the right the divergence of two cumulative
    functions vanishes, its bound does not.
    """
    mean, sd = one
    reach = sd * float(stats.norm.ppf(1 - 0.5 / N_DRAWS))

    def distance(sign: float) -> float:
        def cdf(x: float, law: tuple[float, float]) -> float:
            return float(stats.norm.cdf(sign * (x - law[0]) / law[1]))

        def divergence(x: float) -> float:
            p, q = cdf(x, one), cdf(x, other)
            middle = 0.5 * (p + q)
            return float(xlogy(p, p / middle) + xlogy(q, q / middle)) / math.log(2.0)

        ends = mean - reach, mean + reach
        total, _ = quad(divergence, *ends, limit=200, epsabs=1e-14)
        bound, _ = quad(lambda x: cdf(x, one) + cdf(x, other), *ends, limit=200)
        return math.sqrt(total / bound)

    return max(distance(1.0), distance(-1.0))


def test_distance_is_zero_for_equal_weights_and_blind_to_units() -> None:
    rng = np.random.default_rng(3)
    draws = rng.normal(size=500)
    equal = np.full(500, 1 / 500)
    weights = rng.dirichlet(np.ones(500))
    assert cumulative_distance(draws, equal) == pytest.approx(0.0, abs=1e-7)
    distance = cumulative_distance(draws, weights)
    assert 0 < distance < 1
    assert cumulative_distance(1e9 * draws - 3e9, weights) == pytest.approx(distance, rel=1e-9)


@pytest.mark.parametrize("model", [Conjugate(2.0, 1.0), Conjugate(0.0, 0.7), Conjugate(3.0, 3.0)])
def test_sensitivities_of_a_conjugate_model_are_those_of_quadrature(model: Conjugate) -> None:
    draws = model.draws()
    exact = model.posterior()
    powers = (1 + POWER_STEP, 1 / (1 + POWER_STEP))
    by_prior = [exact_distance(exact, model.posterior(prior_power=power)) for power in powers]
    by_data = [exact_distance(exact, model.posterior(data_power=power)) for power in powers]
    doubling = np.log2(1 + POWER_STEP)
    assert power_scaling_sensitivity(draws, model.log_prior(draws)) == pytest.approx(
        np.mean(by_prior) / doubling, rel=0.03
    )
    assert power_scaling_sensitivity(draws, model.log_likelihood(draws)) == pytest.approx(
        np.mean(by_data) / doubling, rel=0.03
    )


def test_pull_is_the_derivative_of_the_mean() -> None:
    model = Conjugate(2.0, 0.8)
    draws = model.draws()
    step = 1e-4
    (above, sd), (below, _) = model.posterior(2**step), model.posterior(2**-step)
    assert mean_pull(draws, model.log_prior(draws)) == pytest.approx(
        (above - below) / (2 * step * sd), rel=0.01
    )
    assert mean_pull(draws, model.log_likelihood(draws)) > 0


def tree(values: dict[str, FloatArray], log_prior: FloatArray, log_lik: FloatArray) -> xr.DataTree:
    """Draws of one chain with the groups that the table needs."""
    labels = ("chain", "draw")
    posterior = xr.Dataset(
        {name: (labels, draws[None], {"fixed": 0}) for name, draws in values.items()}
    )
    return xr.DataTree.from_dict(
        {
            "posterior": posterior,
            "log_prior": xr.Dataset({"lprior": (labels, log_prior[None])}),
            "log_likelihood": xr.Dataset({"stress": ((*labels, "point"), log_lik[None, :, None])}),
        }
    )


def priors(*given: Prior) -> PriorSet:
    return PriorSet("ice", "test", MappingProxyType({p.parameter: p for p in given}), "test")


def standard_normal(name: str) -> Prior:
    unit = PARAMETER_BY_NAME[name].si_unit
    return Prior(name, "normal", 0.0, 1.0, -np.inf, np.inf, unit, "test")


@pytest.mark.parametrize(
    ("model", "origin"),
    [
        (Conjugate(0.0, 30.0), "this number is your prior"),
        (Conjugate(0.5, 0.05), "the data decide"),
        (Conjugate(8.0, 1.0), "prior and data disagree"),
        (Conjugate(0.0, 1.0), "prior and data agree"),
    ],
)
def test_plain_words_for_a_conjugate_model(model: Conjugate, origin: str) -> None:
    draws = model.draws()
    posterior = tree({"beta": draws}, model.log_prior(draws), model.log_likelihood(draws))
    found = prior_influence(posterior, priors(standard_normal("beta")))
    assert found["beta"].origin == origin
    assert influence_table(found)["where it comes from"].tolist() == [origin]


def influence_of(reading: float, deviation: float, name: str = "beta") -> dict[str, Influence]:
    model = Conjugate(reading, deviation)
    draws = model.draws()
    posterior = tree({name: draws}, model.log_prior(draws), model.log_likelihood(draws))
    return prior_influence(posterior, priors(standard_normal(name)))


def test_a_posterior_far_from_its_prior_is_a_conflict_and_says_how_far() -> None:
    # Data so precise that the prior has no pull, 2.7 standard deviations from its middle.
    found = influence_of(2.7, 0.01)
    assert found["beta"].origin == "the data decide"
    assert found["beta"].distance == pytest.approx(2.7, abs=0.01)
    assert found["beta"].is_conflict
    text = conflict_sentence(found)
    assert text is not None
    assert text.startswith("Prior and data disagree about pre-exponent ln(A)/Q (+2.7 prior sd)")


def test_opposite_pulls_close_to_the_middle_of_a_prior_are_no_conflict() -> None:
    near, far = influence_of(1.2, 1.0)["beta"], influence_of(8.0, 1.0)["beta"]
    assert near.prior_pull * near.likelihood_pull < 0
    assert near.distance == pytest.approx(0.6, abs=0.01)
    assert near.origin == "prior and data both decide"
    assert not near.is_conflict
    assert far.origin == "prior and data disagree"


def test_a_posterior_inside_its_prior_is_no_conflict() -> None:
    found = influence_of(-1.2, 0.01)
    assert found["beta"].distance == pytest.approx(-1.2, abs=0.01)
    assert conflicts(found) == []
    assert conflict_sentence(found) is None


def test_conflicts_are_listed_from_the_furthest() -> None:
    near, far = influence_of(2.2, 0.01)["beta"], influence_of(-4.0, 0.01)["beta"]
    assert near.distance is not None
    assert near.distance > FAR_OUT
    assert conflicts({"stress_exponent": near, "beta": far}) == ["beta", "stress_exponent"]


def test_a_lognormal_prior_counts_in_its_logarithm_and_a_uniform_one_not() -> None:
    draws = np.full(100, np.exp(3.0)) * np.exp(1e-3 * np.random.default_rng(1).normal(size=100))
    law = Prior("kelvin_modulus", "lognormal", 1.0, 1.0, 0.0, np.inf, "Pa", "test")
    flat = Prior("beta", "uniform", 10.0, 10.0, 0.0, 20.5, "mol/J", "test")
    posterior = tree({"kelvin_modulus": draws, "beta": draws}, np.log(draws), np.log(draws))
    found = prior_influence(posterior, priors(law, flat))
    assert found["kelvin_modulus"].distance == pytest.approx(3.0, abs=0.01)
    assert found["beta"].distance is None


def test_the_distance_from_a_prior_that_is_cut_counts_by_probability() -> None:
    """E_M of the ice twins: 1.73 standard deviations below the middle of N(4, 2) cut at 0."""
    draws = 0.54 + 1e-3 * np.random.default_rng(1).normal(size=100)
    law = Prior("maxwell_modulus", "normal", 4.0, 2.0, 0.0, np.inf, "Pa", "test")
    posterior = tree({"maxwell_modulus": draws}, -draws, draws)
    (found,) = prior_influence(posterior, priors(law)).values()
    below, cut = (float(stats.norm.cdf((x - 4.0) / 2.0)) for x in (0.54, 0.0))
    assert found.distance == pytest.approx(stats.norm.ppf((below - cut) / (1 - cut)), abs=0.01)
    assert found.distance == pytest.approx(-2.06, abs=0.01)
    assert "counted by the probability beyond" in THRESHOLDS_TEXT


def test_two_pulls_in_one_direction_are_no_disagreement() -> None:
    draws = np.random.default_rng(2).normal(size=2000)
    posterior = tree({"beta": draws}, 0.4 * draws, 0.6 * draws)
    found = prior_influence(posterior, priors(standard_normal("beta")))
    assert found["beta"].origin == "prior and data both decide"


@pytest.mark.parametrize("scale", [0.5, 1.5, 3.5])
def test_a_wide_lognormal_prior_that_the_data_leave_alone_is_your_prior(scale: float) -> None:
    rng = np.random.default_rng(3)
    law = Prior("kelvin_viscosity", "lognormal", 1e10, scale, 0.0, np.inf, "Pa s", "test")
    score = rng.normal(size=4000)
    posterior = tree(
        {"kelvin_viscosity": law.location * np.exp(scale * score)},
        np.asarray(stats.norm.logpdf(score)),
        -0.5 * rng.chisquare(12, 4000),
    )
    (found,) = prior_influence(posterior, priors(law)).values()
    assert found.origin == "this number is your prior"
    assert found.width == pytest.approx(1.0, abs=0.05)
    assert found.likelihood_sensitivity < SENSITIVE


def test_chance_does_not_let_data_matter_to_skewed_draws() -> None:
    """With 400 draws nine of ten quantities that the data leave alone would be moved by them."""
    flat = Prior("beta", "uniform", 0.5, 100.0, 0.0, 200.0, "mol/J", "test")
    by_chance = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        posterior = tree(
            {"beta": rng.exponential(size=400)}, np.zeros(400), -0.5 * rng.chisquare(12, 400)
        )
        (found,) = prior_influence(posterior, priors(flat)).values()
        by_chance += found.likelihood_sensitivity >= SENSITIVE
        if found.likelihood_sensitivity >= SENSITIVE:
            assert found.origin == "cannot tell from these draws"
    assert by_chance > 20


def test_what_is_pooled_has_no_prior_of_its_own_to_name() -> None:
    """The prior in the file is that of the centre of several tests."""
    model = Conjugate(0.0, 30.0)
    draws = model.draws()
    other = {"stress_exponent": np.random.default_rng(4).normal(size=N_DRAWS)}
    posterior = tree({"beta": draws, **other}, model.log_prior(draws), np.zeros(N_DRAWS))
    laws = priors(standard_normal("beta"), standard_normal("stress_exponent"))
    assert prior_influence(posterior, laws)["beta"].strongest_prior == "beta"
    found = prior_influence(posterior, laws, pooled=("beta",))["beta"]
    assert found.strongest_prior is None
    assert found.origin == "this number is your prior"


def test_a_flat_prior_that_the_data_leave_alone_is_your_prior() -> None:
    draws = np.random.default_rng(2).uniform(0.0, 1.0, 2000)
    flat = Prior("beta", "uniform", 0.5, 0.5, 0.0, 1.0, "mol/J", "test")
    posterior = tree({"beta": draws}, np.zeros(2000), 0.01 * draws)
    (found,) = prior_influence(posterior, priors(flat)).values()
    assert found.prior_sensitivity == pytest.approx(0.0, abs=1e-5)
    assert found.origin == "this number is your prior"


@pytest.mark.parametrize(
    ("by_data", "width", "origin"),
    [
        (0.04, None, "prior and data both decide"),
        (0.02, None, "this number is your prior"),
        (0.04, 0.5, "this number is your prior"),
    ],
)
def test_what_has_no_prior_of_its_own_is_no_priors_number_where_data_move_it(
    by_data: float, width: float | None, origin: str
) -> None:
    found = Influence(
        prior_sensitivity=0.08,
        likelihood_sensitivity=by_data,
        prior_chance=0.02,
        likelihood_chance=0.03,
        prior_pull=0.2,
        likelihood_pull=0.0,
        strongest_prior=None,
        width=width,
        distance=None,
    )
    assert found.origin == origin


@pytest.mark.parametrize(
    ("width", "origin"), [(1.0, "prior and data both decide"), (0.5, "the data decide")]
)
def test_a_flat_prior_that_the_data_hardly_narrow_decides_with_them(
    width: float, origin: str
) -> None:
    draws = np.random.default_rng(2).uniform(0.0, width, 2000)
    flat = Prior("beta", "uniform", 0.5, 0.5, 0.0, 1.0, "mol/J", "test")
    posterior = tree({"beta": draws}, np.zeros(2000), 2.0 * draws / width)
    (found,) = prior_influence(posterior, priors(flat)).values()
    assert found.width == pytest.approx(width, rel=0.05)
    assert found.origin == origin


def test_beta_of_a_short_curve_is_its_prior_and_the_noise_is_not(
    programs: None, tmp_path: Path
) -> None:
    problem = write_problem(
        tmp_path / "inputs",
        free={"maxwell_modulus", "activation_enthalpy", "beta", "stress_noise"},
        max_strain=0.02,
        stride=2,
    )
    one = fit(problem.experiment, problem.priors, out=tmp_path / "run", options=SMALL_RUN)
    found = prior_influence(one.posterior, one.priors)
    assert set(found) == {*one.priors.free, "reference_stress"}
    assert found["beta"].origin == "this number is your prior"
    assert found["beta"].strongest_prior == "beta"
    assert found["stress_noise"].origin == "the data decide"
    assert found["reference_stress"].width is None


def test_a_quantity_on_a_trade_off_is_set_by_the_prior_of_the_other() -> None:
    # Data fix the sum of two quantities; one has a wide uniform prior, the other a normal one.
    rng = np.random.default_rng(5)
    beta = rng.normal(size=4000)
    total = 5 + 0.05 * rng.normal(size=4000)
    wide = Prior("stress_exponent", "uniform", 5.0, 10.0, -5.0, 15.0, "1", "test")
    posterior = tree(
        {"beta": beta, "stress_exponent": total - beta},
        np.asarray(stats.norm.logpdf(beta)),
        np.asarray(stats.norm.logpdf(total, 5, 0.05)),
    )
    found = prior_influence(posterior, priors(wide, standard_normal("beta")))
    exponent = found["stress_exponent"]
    assert exponent.origin == "this number is your prior"
    assert exponent.strongest_prior == "beta"
    assert exponent.likelihood_sensitivity < SENSITIVE < exponent.prior_sensitivity
    assert influence_table(found)["mostly the prior of"].str.contains("pre-exponent").all()
