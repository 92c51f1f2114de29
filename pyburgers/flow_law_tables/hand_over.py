"""Priors of other fits from a fit of tables of rates: its flow law, or some of its mechanisms."""

import numpy as np

from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError, nearest
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import MECHANISM_PARAMETERS, Mechanism
from pyburgers.flow_law_tables.posterior import FLOW_RATE_OF_TEST
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, FlowLawPrior
from pyburgers.model.parameters import (
    FURTHER_MECHANISMS,
    LOWER_LIMITS,
    MECHANISM_REFERENCES,
    PARAMETER_BY_NAME,
)
from pyburgers.model.prior_families import PriorTable
from pyburgers.model.stated_priors import fixed, lognormal, normal


def flow_law_prior(fit: RateFit) -> FlowLawPrior:
    """Return the posterior flow law of another test (see `FlowLawPrior`).

    Its ln(flow rate) scatters as specimens and sources do. If that scatter is one of readings, not
    of samples, the prior is too wide.

    Parameters
    ----------
    fit : RateFit
        Finished fit with the softening of a curve, in which the whole flow law is free.

    Returns
    -------
    FlowLawPrior
        Joint normal prior for `with_flow_law`.

    Raises
    ------
    InputError
        If the law is not that of undeformed material, or a part of it was fixed.

    Examples
    --------
    >>> prior = pyburgers.flow_law_prior(peaks)
    """
    if fit.softening is None:
        raise InputError(
            f"{fit.directory.path}: its tests are not softened, expected a fit with the priors of "
            "a curve (--curve-priors), whose law is that of undeformed material."
        )
    if fixed := fit.law.fixed_flow_law:
        raise InputError(
            f"{fit.directory.path}: {fixed[0]} is fixed, expected a fit in which the whole flow "
            "law is free."
        )
    of_test = all_draws(fit.posterior["predictions"].to_dataset()[FLOW_RATE_OF_TEST])
    draws = {**fit.power_law(), f"log_{REFERENCE_FLOW_RATE}": of_test}
    columns = [draws[name] for name in PRIOR_QUANTITIES]
    return FlowLawPrior(
        quantities=PRIOR_QUANTITIES,
        mean=np.mean(columns, axis=1),
        covariance=np.cov(columns),
        conditions=fit.used.mean_conditions,
        material=fit.data.material,
        source=f"{fit.data.id}: {fit.provenance.source}; its law: {fit.law.priors.title}",
        tests=fit.used.tests,
    )


def mechanism_priors(
    fit: RateFit, second: str, third: str = "", *, temperature: float | None = None
) -> dict[str, PriorTable]:
    """Return mechanisms of a fitted law as priors of further mechanisms of a dashpot.

    Their numbers are independent of each other in these priors, and of the first mechanism: their
    correlations are dropped. ln(rate) scatters as specimens and sources do. A test that the table
    contains should be left out of it (`without_test`).

    Parameters
    ----------
    fit : RateFit
        Finished fit.
    second : str
        Name of the mechanism that becomes the second one of the dashpot. If it shares its process
        with another one than the third, it is in series with the first.
    third : str, optional
        Name of one that becomes the third. If it shares the process of the second, it is in series
        with it.
    temperature : float, optional
        K, of the tests. If the activation enthalpy of a mechanism changes at a temperature, its
        law on this side of it is taken.

    Returns
    -------
    dict of str to PriorTable
        For `PriorSet.with_`.

    Raises
    ------
    InputError
        If there is no such mechanism, or its activation enthalpy changes and no temperature is
        given. If the third is in series with another one than the second.

    Examples
    --------
    >>> second = pyburgers.mechanism_priors(creep, "creep")
    >>> ice = pyburgers.priors("ice").with_(**second)
    """
    found = {one.name: one for one in fit.law.mechanisms}
    names = [name for name in (second, third) if name]
    for name in names:
        if name not in found:
            raise InputError(
                f"{fit.directory.path}: has no mechanism {name!r}, {nearest(name, found)}"
            )
        if found[name].premelting_temperature and temperature is None:
            raise InputError(
                f"{fit.directory.path}: the activation enthalpy of {name} changes at "
                f"{found[name].premelting_temperature:g} K, expected the temperature of the tests."
            )
    processes = [found[name].process for name in names]
    others = {one.process for one in fit.law.mechanisms if one.name not in names}
    if third and processes[1] in others:
        raise InputError(
            f"{fit.directory.path}: {third} is in series with a mechanism other than {second}, "
            "expected them the other way round, or one mechanism."
        )
    in_series = (processes[0] in others, len(set(processes)) < len(processes))
    tables: dict[str, PriorTable] = {}
    for which, name, flag in zip(FURTHER_MECHANISMS, names, in_series, strict=False):
        tables |= _priors_of(fit, found[name], which, temperature or 0.0, in_series=flag)
    return tables


def _priors_of(
    fit: RateFit, mechanism: Mechanism, which: str, temperature: float, *, in_series: bool
) -> dict[str, PriorTable]:
    """Return a mechanism, at a temperature (K), as priors of the second or the third one."""
    predictions = fit.posterior["predictions"].to_dataset()
    law = predictions["law"].sel(mechanism=mechanism.name)
    log_rate, exponent, grain_size_exponent, enthalpy, premelting, *environment = (
        all_draws(law.isel(column=MECHANISM_PARAMETERS.index(name)))
        for name in (*MECHANISM_PARAMETERS[:5], *mechanism.environment)
    )
    at, change = fit.law.reference, mechanism.premelting_temperature
    if 0.0 < change < temperature:
        # The same rate at the change (`stan/physics/composite_law.stan`).
        slower = 1 / change - 1 / at.temperature
        log_rate = log_rate + (premelting - enthalpy) / GAS_CONSTANT * slower
        enthalpy = premelting
    mean_rate = all_draws(fit.posterior["posterior"].to_dataset()[REFERENCE_FLOW_RATE])
    log_rate = log_rate + all_draws(predictions[FLOW_RATE_OF_TEST]) - np.log(mean_rate)
    rate, *numbers, flag = FURTHER_MECHANISMS[which]
    bounds = (LOWER_LIMITS[numbers[0]][0], 0.0, 0.0, *[None] * len(environment))
    numbers += [f"{which}_{name}" for name in mechanism.environment]
    draws = (exponent, grain_size_exponent, enthalpy, *environment)
    constants = (float(in_series), at.stress, at.grain_size, at.temperature)
    source = f"{fit.data.id}: {fit.provenance.source}; {mechanism.name} of {fit.law.priors.title}"

    def unit(name: str) -> str:
        return PARAMETER_BY_NAME[name].si_unit

    median = float(np.exp(log_rate.mean()))
    tables = {rate: lognormal(median, float(log_rate.std()), unit(rate), source=source)}
    for name, lower, own in zip(numbers, bounds, draws, strict=True):
        tables[name] = (
            normal(float(own.mean()), float(own.std()), unit(name), lower=lower, source=source)
            if np.ptp(own) > 0
            else fixed(float(own[0]), unit(name), source=source)
        )
    for name, value in zip((flag, *MECHANISM_REFERENCES), constants, strict=True):
        tables[name] = fixed(value, unit(name), source=source)
    return tables
