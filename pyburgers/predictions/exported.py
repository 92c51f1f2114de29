"""Flow law and elements of a fit as mean with covariance, for use in other codes."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from pyburgers.checks.prior_influence import Origin, decision_columns, decision_text, symbol_of
from pyburgers.common.array_types import FloatArray
from pyburgers.common.csv_tables import csv_text, in_one_line
from pyburgers.common.draws import all_draws
from pyburgers.common.units import rounded
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import PRIOR_ALONE, SampledFit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import SCATTER
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.conditions import ENVIRONMENT_WORDS, Ranges, ranges_text, widest
from pyburgers.kinds.experiment import Experiment
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.display import shown_quantity, unit_text
from pyburgers.model.parameters import CONDITIONS, ENVIRONMENT, RESIDUAL_CORRELATION, UNSIGNED
from pyburgers.model.priors import FLOW_LAW, JOINT_PRIOR
from pyburgers.model.read_quantities import BY_NOISE
from pyburgers.posterior.labelled_draws import own_name
from pyburgers.predictions.stated_laws import (
    LOGARITHM,
    POWER_LAW,
    composite_law,
    is_logarithm,
    laws_of,
    undeformed,
)

VARIABLES: Mapping[str, str] = MappingProxyType(
    {
        "stress": "Pa",
        "temperature": "K",
        "grain_size": "m",
        "initial_grain_size": "m",
        "fabric_factor": "1",
        "path_strain": "1, integral of |total strain rate| over time",
        "kelvin_strain": "1",
        "backstress": "Pa",
        "pressure": "Pa",
        "water_fugacity": "Pa",
        "melt_fraction": "1",
        "time": "s",
        "R": f"{GAS_CONSTANT:.10g} J/(mol K)",
    }
)
"""Units of the variables, and the gas constant; stress and strain are positive in compression."""

LOG_FACTOR = f"{LOGARITHM}flow_law_factor"
"""ln A in SI units, which β and Q_M give: A = exp(β Q_M)."""

LEFT_OUT = CONDITIONS | {
    *BY_NOISE,
    *RESIDUAL_CORRELATION,
    *ENVIRONMENT,
    *("strain_offset", "apparatus_compliance"),
}
"""Parameters that belong to a test or its readings, not to the material."""


@dataclass(frozen=True, eq=False)
class Exported:
    """Mean (n,) and covariance (n, n) of the parameters of a material, in SI units.

    Names hold parameters, sampled ones and fixed ones, `LOG_FACTOR`, and logarithms in the place
    of the rates of mechanisms; a fixed one has no covariance and is decided by "fixed". Notes tell
    which draws these are, conflicts, numbers that the data alone do not decide, and those that need
    draws. Laws are those that were fitted (`laws_of`). Draws have shape (n, n_draws); `first_chain`
    is the beginning of a hash.
    """

    test: str
    material: str
    variant: str
    run: str
    draws_of: str
    conditions: str
    sampled_well: str
    describes_data: str
    names: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    n_draws: int
    decided_by: tuple[str, ...]
    by_prior_of: tuple[str, ...]
    notes: tuple[str, ...]
    laws: Mapping[str, object]
    first_chain: str = ""
    draws: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def sd(self) -> FloatArray:
        """Posterior standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def fitted_ranges(fit: Fit | RateFit) -> Ranges:
    """Return the conditions of the fitted tests, or of the tests of a table."""
    if isinstance(fit, Fit):
        return widest(fit.fitted_conditions)
    data = fit.used
    columns = {
        "temperature": data.temperature,
        "initial grain size": data.grain_size,
        "strain rate": data.strain_rate,
        "stress": data.stress,
        **{
            words: getattr(data, name)
            for words, name in zip(ENVIRONMENT_WORDS, ENVIRONMENT, strict=True)
        },
    }
    known = {name: one[np.isfinite(one)] for name, one in columns.items()}
    return {name: (float(one.min()), float(one.max())) for name, one in known.items() if one.size}


def exported(fit: Fit | RateFit) -> Exported:
    """Return what other codes need of a fit; beta gives tables the names of a curve's flow law."""
    about: Experiment | RateTable
    own: dict[str, str] = {}
    notes: tuple[str, ...] = ()
    if isinstance(fit, Fit):
        about, priors, variant = fit.experiment, fit.priors, fit.variant.short_text
        left_out = LEFT_OUT | about.without_effect
        columns = _draws_of(fit, [name for name in priors.priors if name not in left_out])
        laws = laws_of(priors, about, (fit.whole or fit).variant)
    else:
        about, priors, variant = fit.data, fit.law.priors, fit.law.priors.title
        columns, own, laws = _law_of_tables(fit)
        if fit.law.enhancements:
            excess = " or ".join(fit.law.enhancements)
            notes = (f"Steady rates of tests are {excess} times their least rates.",)
    if "beta" in columns:
        columns[LOG_FACTOR] = columns["beta"] * columns["activation_enthalpy"]
    values = np.stack(list(columns.values()))
    fixed = np.ptp(values, axis=1) == 0
    mean = np.where(fixed, values[:, 0], values.mean(axis=1))
    covariance = np.atleast_2d(np.cov(values))
    # Rounding would give what never varies a spread, and correlations of 1.
    covariance[fixed, :] = covariance[:, fixed] = 0.0
    own = {name: own.get(name, name) for name in columns}
    derived = {own[name]: one for name, one in columns.items() if own[name] not in priors.priors}
    (influences,) = fit.influences(derived).values() or ({},)
    decided = [decision_columns(influences.get(own[name])) for name in columns]
    undecided = Origin.PRIOR.value if fit.draws_of == PRIOR_ALONE else ""
    return Exported(
        test=about.id,
        material=about.material,
        variant=variant,
        run=fit.directory.path.name,
        draws_of=fit.draws_of,
        conditions=ranges_text(fitted_ranges(fit)).translate(ASCII_SIGNS),
        sampled_well=fit.sampled_well.value,
        describes_data=fit.describes_data.value,
        names=tuple(columns),
        mean=mean,
        covariance=covariance,
        n_draws=values.shape[1],
        decided_by=tuple(
            "fixed" if known else str(one["decided_by"] or undecided)
            for known, one in zip(fixed, decided, strict=True)
        ),
        by_prior_of=tuple(
            "" if known else str(one["by_prior_of"])
            for known, one in zip(fixed, decided, strict=True)
        ),
        notes=(
            fit.which_draws,
            *notes,
            *fit.origins,
            *fit.prior_conflicts(),
            *fit.prior_decisions(),
            *wide_notes([*columns], mean, covariance),
        ),
        laws=laws,
        first_chain=fit.first_chain,
        draws=values,
    )


def wide_notes(names: Sequence[str], mean: FloatArray, covariance: FloatArray) -> tuple[str, ...]:
    """Say which positive quantities are not described by mean (n,) and covariance (n, n), if any.

    A normal law of them would have negative values in more than two percent of draws.
    """
    wide = [
        name
        for name, middle, variance in zip(names, mean, np.diag(covariance), strict=True)
        if not (is_logarithm(name) or name.partition("[")[0] in UNSIGNED)
        and np.sqrt(variance) > middle / 2
    ]
    if not wide:
        return ()
    return (
        "Mean and covariance are not enough for a positive quantity with a standard deviation "
        f"above half of its mean ({', '.join(wide)}): use draws (sample).",
    )


def _draws_of(fit: SampledFit, names: Iterable[str]) -> dict[str, FloatArray]:
    """Return draws (n_draws,) by name."""
    draws = fit.posterior["posterior"].to_dataset()
    return {name: all_draws(draws[name]) for name in names}


def _law_of_tables(fit: RateFit) -> tuple[dict[str, FloatArray], dict[str, str], dict[str, object]]:
    """Return draws (n_draws,) by name, names of their priors if they are others, and the laws."""
    law, scatter = fit.law, _draws_of(fit, [*fit.law.enhancements, SCATTER])
    microstructure = {"microstructure": {"undeformed": undeformed("initial_grain_size")}}
    if law.is_power_law and law.power_law.has_beta:
        own = {name: own_name(name, law.power_law.name) for name in FLOW_LAW}
        return {**fit.power_law(), **scatter}, own, {"flow_law": POWER_LAW, **microstructure}
    names = [own_name(name, one.name) for one in law.mechanisms for name in one.stated_parameters]
    # A rate may be uncertain by more than itself: mean and sd of its logarithm describe it.
    columns = {
        f"{LOGARITHM}{name}" if name.startswith("mechanism_rate") else name: one
        for name, one in _draws_of(fit, names).items()
    }
    columns |= {name: np.log(one) for name, one in columns.items() if is_logarithm(name)}
    return {**columns, **scatter}, {}, {**composite_law(law), **microstructure}


def _si_unit(name: str) -> str:
    return "1" if is_logarithm(name) else shown_quantity(name).si_unit


def as_json(one: Exported, kept: Sequence[int] = ()) -> str:
    """Return a JSON object; with kept draws, their values in the order of the names."""
    content: dict[str, Any] = {
        **{
            name: getattr(one, name)
            for name in (
                *("test", "material", "variant", "run", "draws_of", "conditions"),
                *("sampled_well", "describes_data"),
            )
        },
        "draws": one.n_draws,
        **one.laws,
        "variables": dict(VARIABLES),
        "names": list(one.names),
        "units": [_si_unit(name) for name in one.names],
        "mean": one.mean.tolist(),
        "sd": one.sd.tolist(),
        "decided_by": list(one.decided_by),
        "by_prior_of": list(one.by_prior_of),
        "notes": list(one.notes),
        "covariance": one.covariance.tolist(),
    }
    if len(kept):
        content["sample"] = one.draws[:, kept].T.tolist()
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def as_csv(one: Exported) -> str:
    """Return name, unit, mean, sd, who decides, and a column of the covariance for each name."""
    table = pd.DataFrame(
        {
            "name": one.names,
            "unit": map(_si_unit, one.names),
            "mean": one.mean,
            "sd": one.sd,
            "decided_by": one.decided_by,
            "by_prior_of": one.by_prior_of,
            "draws_of": one.draws_of,
            "draws": one.n_draws,
            "first_chain_sha256": one.first_chain,
        }
    )
    covariance = pd.DataFrame(one.covariance, columns=[f"cov_{name}" for name in one.names])
    return csv_text(table.join(covariance))


def as_latex(one: Exported) -> str:
    """Return a booktabs table of means and sd in display units, with correlations."""
    free = [k for k, sd in enumerate(one.sd) if sd > 0]
    notes = [
        f"{one.test}, {one.material}, model {one.variant}",
        f"sampled well: {one.sampled_well}, describes the data: {one.describes_data}",
        f"conditions of the fitted tests: {one.conditions}",
        *one.notes,
        *_law_lines(one.laws),
    ]
    lines = [
        *(f"% {in_one_line(note)}" for note in notes),
        rf"\begin{{tabular}}{{llrl{'r' * len(free)}}}",
        r"\toprule",
        " & ".join(
            ["", "unit", "mean $\\pm$ sd", "decided by"]
            + [f"${_symbol(one.names[k])}$" for k in free]
        )
        + r" \\",
        r"\midrule",
    ]
    scale = one.sd[free]
    correlation = one.covariance[np.ix_(free, free)] / np.outer(scale, scale)
    for k, name in enumerate(one.names):
        factor, unit = _display(name)
        spread = _in_latex(one.mean[k] * factor, one.sd[k] * factor)
        row = correlation[free.index(k)] if k in free else np.full(len(free), np.nan)
        cells = ["" if np.isnan(value) else f"${value:z.2f}$" for value in row]
        decided = decision_text(name, one.decided_by[k], one.by_prior_of[k], _symbol_in_text)
        lines.append(" & ".join([f"${_symbol(name)}$", unit, spread, decided, *cells]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _in_latex(mean: float, sd: float) -> str:
    """Return mean and sd with a common power of ten where plain digits are hard to read."""
    exponent = int(f"{max(abs(mean), sd):.3e}".partition("e")[2])
    if -4 <= exponent < 4:
        exponent = 0
    power = rf" \times 10^{{{exponent}}}" if exponent else ""
    mean, sd = mean / 10.0**exponent, sd / 10.0**exponent
    if not sd:
        return f"${mean:.4g}{power}$ (fixed)"
    spread = rf"{rounded(mean, sd)} \pm {rounded(sd, sd)}"
    return f"$({spread}){power}$" if power else f"${spread}$"


def _law_lines(laws: Mapping[str, object], under: str = "") -> list[str]:
    lines: list[str] = []
    for name, law in laws.items():
        if isinstance(law, Mapping):
            lines += _law_lines(law, f"{under}{name} ")
        else:
            lines.append(f"{under}{name}: {law}")
    return lines


def _symbol(name: str) -> str:
    if is_logarithm(name):
        of = name.removeprefix(LOGARITHM)
        return r"\ln A" if name == LOG_FACTOR else rf"\ln {_symbol_of_owner(of)}"
    return _symbol_of_owner(name)


def _symbol_of_owner(name: str) -> str:
    """Return the symbol of a quantity, what it belongs to upright."""
    base, _, owner = name.removesuffix("]").partition("[")
    upright = owner.replace("_", r"\_")
    return shown_quantity(base).symbol + (rf"[\mathrm{{{upright}}}]" if owner else "")


def _symbol_in_text(name: str) -> str:
    return symbol_of(name) if name == JOINT_PRIOR else f"${_symbol(name)}$"


def _display(name: str) -> tuple[float, str]:
    """Return the factor to the unit of a table, and that unit: of rates SI, else for display."""
    if is_logarithm(name):
        return 1.0, "ln of SI"
    quantity = shown_quantity(name)
    if quantity.display_unit.startswith("1e"):
        return 1.0, quantity.si_unit
    return quantity.display_factor, unit_text(quantity).translate(LATEX_SIGNS)


ASCII_SIGNS = str.maketrans({"µ": "u", "±": "+-"})
"""Signs in comments of files that other programs read."""

LATEX_SIGNS = str.maketrans({"%": r"\%", "µ": r"$\mu$", "–": "--", "³": "$^{3}$"})
"""Signs of units as LaTeX has them."""

_BEGINNING = re.compile(
    r'\{\n "test": |name,unit,mean,sd,(decided_by,|cov_)|% .*\n% sampled well: '
    r'|[#!] pyburgers export |\{\n "[^\n]*, pyburgers export": '
)
"""Of all formats (`pyburgers.predictions.exports`)."""


def is_exported(path: Path) -> bool:
    """Whether a file looks like one of the formats, of any fit."""
    with path.open(encoding="utf-8", errors="replace") as file:
        return _BEGINNING.match(file.read(10000)) is not None
