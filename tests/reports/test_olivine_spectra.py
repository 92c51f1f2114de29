"""Measured spectra of olivine in the study: what is fitted, and what the page says of it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from conftest import with_fixed
from olivine_spectra import (
    BAND,
    BAND_DRAWS,
    LAWS,
    hottest_of,
    left_over,
    remaining_sentence,
    run_name,
    spectra_section,
    spectra_tasks,
)

from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.sampling.options import SamplerOptions

FEW = SamplerOptions(chains=2, warmup=100, draws=60, seed=1, adapt_delta=0.8, coordinates="plain")

KNOWN = {
    "activation_enthalpy": 453.9e3,
    "beta": -7.138e-5,
    "modulus_temperature_coefficient": -2.09e-4,
    "relaxation_time_decades": 8.2,
}
"""What a few rows tell least of (SI), near the means of the shipped fit of a band."""


def few_rows(table: AttenuationExperiment, runs: str) -> AttenuationExperiment:
    """Every second period of the hottest temperatures, so that a fit takes a second."""
    hot = np.flatnonzero(table.conditions.temperature > 1370)[::2]
    return replace(
        table,
        id=runs,
        conditions=table.conditions.ordered(hot),
        readings=table.readings.ordered(hot),
    )


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Fit]:
    folder = tmp_path_factory.mktemp("spectra")
    found = {}
    for name, task in spectra_tasks(FEW).items():
        (table,), priors = task.problem.experiments, task.problem.given_priors
        assert isinstance(table, AttenuationExperiment)
        known = {own: value for own, value in KNOWN.items() if own in priors.free}
        priors = with_fixed(priors, known)
        found[name] = fit(few_rows(table, name), priors, out=folder / name, options=FEW)
    return found


def test_each_law_is_fitted_with_and_without_the_hottest_temperature() -> None:
    tasks = spectra_tasks(FEW)
    names = [run_name(law, without_hottest=part) for law in LAWS for part in (False, True)]
    assert list(tasks) == names
    for name, task in tasks.items():
        (table,) = task.problem.experiments
        assert isinstance(table, AttenuationExperiment)
        assert table.id == name
        assert table.provenance.kind == "measured"
        assert task.options.warmup is None
        assert task.options.draws == (BAND_DRAWS if name.startswith(run_name(BAND)) else FEW.draws)
        hottest = table.conditions.temperature.max()
        assert hottest == pytest.approx(1423.15 if name.endswith("hottest") else 1473.15)


def test_the_page_says_how_well_both_laws_do(fits: Mapping[str, Fit]) -> None:
    section = spectra_section(fits)
    (table,) = section.tables
    rows = table.saved.set_index("law").to_dict("index")
    for column in ("rms_log_tan_delta", "predicted_rms_log_tan_delta"):
        assert rows["band"][column] < 0.5 * rows["one element"][column]
    told = " ".join((*section.paragraphs, *section.details))
    assert "Qu, T., Jackson" in told
    assert told.count("Of 10 points lie") == 2
    for law in LAWS:
        for verdict in fits[run_name(law)].verdicts().values():
            assert verdict.sentence in told
    for figure in section.figures:
        assert figure.draw().axes


def test_what_is_left_of_whole_temperatures_is_told(fits: Mapping[str, Fit]) -> None:
    one = fits[run_name("one element")]
    residual = left_over(one)[1]
    table = one.experiment
    assert isinstance(table, AttenuationExperiment)
    means = [
        residual[table.conditions.temperature == own].mean()
        for own in np.unique(table.conditions.temperature)
    ]
    largest = max(means, key=abs)
    told = remaining_sentence(residual, table.conditions.temperature)
    assert f"up to {100 * largest:+.1f} %" in told


@pytest.mark.parametrize(("shared", "explained"), [(0.0, False), (3.0, True)])
def test_a_cause_of_what_is_left_is_named_where_whole_temperatures_have_most_of_it(
    shared: float, explained: bool
) -> None:
    rng = np.random.default_rng(2)
    temperature = np.repeat(np.linspace(1000.0, 1500.0, 8), 10)
    residual = 0.01 * (rng.normal(size=80) + shared * np.repeat(rng.normal(size=8), 10))
    told = remaining_sentence(residual, temperature)
    assert "(10 % if readings err each for itself)" in told
    assert ("an error that readings of a temperature share" in told) is explained


def test_the_hottest_spectrum_is_a_table_of_its_own(fits: Mapping[str, Fit]) -> None:
    table = fits[run_name("band")].experiment
    assert isinstance(table, AttenuationExperiment)
    hottest = hottest_of(table)
    rest = table.without_part(next(iter(table.parts)))
    assert np.ptp(hottest.conditions.temperature) == 0
    assert hottest.n_points + rest.n_points == table.n_points
