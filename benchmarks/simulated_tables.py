"""Calibration of the hand-over from tables of peak stresses: whether its prior holds the truth.

For each data set a material is drawn from the priors of a curve. The peaks of a table's tests are
solved with its parameters, each specimen with a factor of its rate, and the table is fitted. The
flow law
of one more test of that scatter is ranked among draws of the prior that the fit hands on
(`pyburgers.flow_law_prior`). A curve of this test is fitted with this prior,
and every parameter is ranked among the draws of the posterior.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pyburgers import PriorSet, SamplingError, fit_rates, flow_law_prior, with_flow_law
from pyburgers.checks.fit_checks import CheckKind
from pyburgers.common.draws import FloatArray
from pyburgers.flow_law_tables.laws import SCATTER, RateLaw, with_curve_flow_law
from pyburgers.flow_law_tables.softening import simulate_peaks
from pyburgers.flow_law_tables.tables import PeakStrain, RateTable
from pyburgers.kinds.experiment import Experiment, Provenance
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.problem import one_test
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, FlowLawPrior
from pyburgers.sbc.data_sets import DataSetPlan, Simulated, fit_and_rank, lengthened
from pyburgers.sbc.replication import Replication

LARGEST_RATIO = 3.0
"""Of the mean stress of a simulated table to that of its template, or the reverse: others are drawn
again. That is a choice by data alone, which leaves the ranks of a right prior uniform."""

PRIOR_ATTEMPTS = 1000
"""Draws at which a simulation gives up."""

CURVE_STREAM = 1
"""Of random numbers for the noise of a curve, beside those of its table."""

TABLE_STREAM = 1000
"""Of random numbers for a table. The fit of the table simulates its prior from the seed itself:
with the same numbers, the truth would be the first material there. Chains start from streams of
their numbers."""


@dataclass(frozen=True, eq=False)
class SimulatedTable:
    """A table of peak stresses, of the model with scatter, whose truth is known."""

    data: RateTable
    values: dict[str, float]
    """Parameters (SI) of the material."""
    offset: float
    """ln(flow rate) of one more test less that of the material."""

    def truth(self, law: FlowLawPrior) -> FloatArray:
        """Quantities of a `FlowLawPrior`, shape (4,), of the one more test."""
        log_rate = float(law.log_flow_rate(self.values)) + self.offset
        known = {**self.values, PRIOR_QUANTITIES[2]: log_rate}
        return np.array([known[name] for name in PRIOR_QUANTITIES])


def simulate_table(
    template: RateTable, law: RateLaw, curve: PriorSet, *, seed: int
) -> SimulatedTable:
    """Draw materials and solve the peaks of a table's tests until they look like it.

    If the template states the strain of its peaks, the simulated table states its own, with the
    same relative standard deviation. Raises SamplingError if no draw has stresses like those of the
    template.
    """
    rng = np.random.default_rng([seed, TABLE_STREAM])
    for _ in range(PRIOR_ATTEMPTS):
        values = curve.resolved(float(template.stress.max())).sample(rng)
        scatter = law.priors[SCATTER].sample(rng)
        faster = scatter * rng.standard_normal(template.n_rows) / values["activation_enthalpy"]
        try:
            peaks = simulate_peaks(
                template.material,
                [{**values, "beta": values["beta"] + float(one)} for one in faster],
                strain_rate=template.strain_rate,
                grain_size=template.grain_size,
                temperature=template.temperature,
            )
        except SamplingError:
            continue  # its stresses are not those of a laboratory either
        misread = template.reading_error * rng.standard_normal(template.n_rows)
        log_stress = np.diag(peaks.log_stress) + misread
        level = np.mean(log_stress - np.log(template.stress))
        if abs(level) <= np.log(LARGEST_RATIO):
            break
    else:
        raise SamplingError(
            f"{template.id}: none of {PRIOR_ATTEMPTS} draws from the priors has stresses like "
            "those of the table; check the units and the bounds of the priors."
        )
    stated = None
    if template.peak_strain is not None:
        relative = template.peak_strain.sd / template.peak_strain.mean
        mean = np.exp(np.mean(np.log(np.diag(peaks.strain))) + relative * rng.standard_normal())
        stated = PeakStrain(float(mean), float(relative * mean))
    data = replace(
        template,
        id=f"{template.id}_simulated_{seed}",
        stress=np.exp(log_stress),
        provenance=Provenance("synthetic", f"pyburgers, a draw from the prior, seed {seed}"),
        peak_strain=stated,
    )
    return SimulatedTable(data, values, float(scatter * rng.standard_normal()))


@dataclass(frozen=True, eq=False)
class RankedTable:
    """The prior that the fit of a simulated table hands on, and ranks of one more test in it."""

    law: FlowLawPrior
    ranks: dict[str, int]
    """Draws of the prior below the truth, by quantity; empty if the last fit failed a check."""
    n_refits: int
    """Longer fits after the first."""
    failed_checks: tuple[str, ...]
    """Names of the checks of the sampling that the last fit failed."""


def rank_hand_over(
    template: RateTable,
    law: RateLaw,
    curve: PriorSet,
    out: Path,
    *,
    seed: int,
    plan: DataSetPlan,
) -> RankedTable:
    """Simulate a table, fit it, and rank one more test's flow law in the prior handed on.

    A fit that fails a check of the sampling is repeated, longer; one that still does is not ranked.
    """
    table = simulate_table(template, law, curve, seed=seed)
    failed: tuple[str, ...] = ()
    for n_refits in range(plan.refits + 1):
        fit = fit_rates(
            table.data,
            with_curve_flow_law(law, curve),
            out=out / f"table_{n_refits}",
            curve=curve,
            options=lengthened(replace(plan.sampler, seed=seed), n_refits, failed),
        )
        failed = tuple(
            one.name
            for one in fit.checks()
            if not one.passed and one.check.kind is CheckKind.SAMPLING
        )
        if not failed:
            break
    found = flow_law_prior(fit)
    rng = np.random.default_rng([seed, plan.n_ranked])
    draws = found.mean + rng.standard_normal((plan.n_ranked, found.mean.size)) @ found.factor.T
    below = np.sum(draws < table.truth(found), axis=0)
    ranks = {} if failed else dict(zip(found.quantities, map(int, below), strict=True))
    return RankedTable(found, ranks, n_refits, failed)


def rank_curve(
    table: SimulatedTable,
    law: FlowLawPrior,
    template: Experiment,
    curve: PriorSet,
    out: Path,
    *,
    seed: int,
    plan: DataSetPlan,
) -> Replication:
    """Simulate the curve of one more test, fit it with the prior handed on, and rank its truth.

    The test has the parameters of the table's material; its flow rate scatters as those of the
    table do. Raises SamplingError if the curve has no solution.
    """
    rng = np.random.default_rng([seed, CURVE_STREAM])
    truth = table.truth(law)
    values = {
        **table.values,
        "activation_enthalpy": float(law.activation_enthalpy(*truth)),
        "stress_noise": curve["stress_noise"].sample(rng),
    }
    source = f"one more test of {table.data.id}"
    curve = with_flow_law(curve, law, source)
    simulated = simulate_data(template, values, rng, source=source)
    named = replace(simulated, id=f"{template.id}_simulated_{seed}")
    return fit_and_rank(
        Simulated(one_test(named, curve), {}, 0, 0),
        one_test(template, curve),
        out,
        seed=seed,
        plan=plan,
    )
