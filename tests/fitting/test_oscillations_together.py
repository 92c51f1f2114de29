"""Several records of oscillations fitted together."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import SMALL_RUN, with_fixed
from oscillation_pair import oscillation_pair
from page import html_of
from truths import truth_of

from pyburgers.fitting.fit import Fit, fit
from pyburgers.model.priors import default_priors
from pyburgers.page.joint_section import joint_section
from pyburgers.page.names import page_names

pytestmark = pytest.mark.slow

FREE = ("kelvin_modulus", "activation_enthalpy", "stress_noise")


@pytest.fixture(scope="module")
def joint(programs: None, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    experiments = oscillation_pair(end=700.0)
    truth = truth_of(experiments[0])
    priors = default_priors("olivine")
    known = {name: truth[name] for name in priors.free if name not in FREE}
    return fit(
        experiments,
        with_fixed(priors, known),
        out=tmp_path_factory.mktemp("joint") / "run",
        options=replace(SMALL_RUN, warmup=60, draws=40),
    )


def test_material_is_shared_and_noise_is_not(joint: Fit) -> None:
    first, other = (joint[name].posterior["posterior"].to_dataset() for name in joint.tests())
    for name in ("kelvin_modulus", "activation_enthalpy"):
        np.testing.assert_array_equal(first[name], other[name])
    assert not np.array_equal(first["stress_noise"], other["stress_noise"])
    # At another temperature and stress the undeformed material flows at another rate.
    assert float(other["reference_flow_rate"].mean() / first["reference_flow_rate"].mean()) != 1
    assert {"kelvin_modulus", "stress_noise[record_2]", "reference_flow_rate[record_1]"} <= set(
        joint.summary("SI").index
    )


def test_every_record_has_its_own_solutions(joint: Fit) -> None:
    for name, test in joint.tests().items():
        (experiment,) = test.problem.experiments
        assert experiment.id == name
        predicted = test.posterior["posterior_predictive"]["stress"].mean(("chain", "draw"))
        residual = experiment.response - predicted.to_numpy()
        noise = float(test.posterior["posterior"]["stress_noise"].mean())
        assert np.std(residual) < 1.3 * noise


def test_a_page_shows_both_records(joint: Fit, sketched: None, tmp_path: Path) -> None:
    section = joint_section("joint", "both records", joint, [])
    page = html_of([*joint.tests().values()], tmp_path / "report", extras=[section])
    assert "Joint fit both records" in page
    (name,) = page_names([joint["record_2"]])
    assert name in page
