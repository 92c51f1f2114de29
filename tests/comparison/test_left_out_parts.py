"""Temperatures of a table of attenuation left out, against marginal likelihoods by quadrature."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import attenuation_oracle
import numpy as np
import pytest
from conftest import ICE, with_fixed
from kind_examples import AttenuationExample
from scipy.integrate import trapezoid
from scipy.special import logsumexp

from pyburgers.common.errors import InputError
from pyburgers.comparison.by_tests import compare_by_test, compare_kept_by_test
from pyburgers.comparison.conclusions import sentences_by_test
from pyburgers.fitting.fit import fit
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions

TWIN = load_attenuation(ICE / "attenuation_twin.toml")


def log_evidence(table: AttenuationExperiment, truth: Mapping[str, float]) -> float:
    """Log marginal likelihood where the activation enthalpy alone is unknown."""
    prior = default_priors("ice", "attenuation")["activation_enthalpy"].distribution()
    enthalpies = truth["activation_enthalpy"] * np.linspace(0.995, 1.005, 61)
    rows = np.arange(table.conditions.n_rows)
    logarithms = []
    for enthalpy in enthalpies:
        values = {**truth, "activation_enthalpy": float(enthalpy)}
        tan_delta, of_modulus = attenuation_oracle.log_readings(
            table, values, table.conditions.period, rows
        )
        centre = np.log(np.hypot(np.exp(tan_delta), table.readings.tan_delta_error))
        response = np.append(
            np.maximum(centre, np.log(np.maximum(table.readings.limit, 1e-300))), of_modulus
        )
        likelihood = AttenuationExample().log_likelihood(table, values, response)
        logarithms.append(float(np.sum(likelihood) + prior.logpdf(enthalpy)))
    largest = float(logsumexp(logarithms))
    return largest + float(np.log(trapezoid(np.exp(np.array(logarithms) - largest), enthalpies)))


@pytest.mark.slow
@pytest.mark.usefixtures("programs", "in_this_process")
def test_temperatures_are_left_out_one_by_one(tmp_path: Path) -> None:
    assert TWIN.true_parameters is not None
    truth = dict(TWIN.true_parameters)
    priors = default_priors("ice", "attenuation")
    known = {name: truth[name] for name in priors.free if name != "activation_enthalpy"}
    result = fit(
        TWIN,
        with_fixed(priors, known),
        out=tmp_path / "run",
        options=SamplerOptions(chains=2, warmup=100, draws=300, seed=3),
    )
    comparison = compare_by_test({"one": result})
    found = comparison.results["one"]
    assert found.tests == ("253.15K", "263.15K")
    assert found.n_points.tolist() == [36, 36]
    whole = log_evidence(TWIN, truth)
    expected = [whole - log_evidence(TWIN.without_part(name), truth) for name in found.tests]
    np.testing.assert_allclose(found.elpd, expected, atol=0.1)
    assert "the temperatures have" in sentences_by_test(comparison)[0]
    kept = compare_kept_by_test({"one": result})
    assert kept is not None
    np.testing.assert_array_equal(kept.results["one"].elpd, found.elpd)


def test_temperatures_of_one_name_are_one_part_with_all_their_readings() -> None:
    conditions = TWIN.conditions
    nudge = np.where(np.arange(conditions.temperature.size) % 2 == 0, 1e-4, 0.0)
    close = replace(
        TWIN, conditions=replace(conditions, temperature=conditions.temperature + nudge)
    )
    assert dict(close.parts) == dict(TWIN.parts)
    assert list(close.parts) == list(TWIN.parts)
    assert close.without_part("253.15K").n_points == TWIN.without_part("253.15K").n_points


def test_only_a_temperature_of_the_table_can_be_left_out() -> None:
    assert TWIN.without_part("253.15K").conditions.n_spectra == 2
    with pytest.raises(InputError, match="has no part '250K'"):
        TWIN.without_part("250K")
    with pytest.raises(InputError, match="no other temperature"):
        TWIN.without_part("253.15K").without_part("263.15K")
