"""Tables for people: display units, digits by the standard deviation, priors and truth beside."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CheckResult, Outcome
from pyburgers.checks.prior_influence import READ_OFF, Influence, Origin, decision_text
from pyburgers.common.draws import band_text, is_misled_by_sd
from pyburgers.common.units import number, rounded
from pyburgers.drawing.page_parts import PageTable
from pyburgers.fitting.fit import Fit
from pyburgers.model.display import prior_text, shown_quantity, symbol_text, unit_text
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.parameters import PARAMETER_BY_NAME, Parameter
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet
from pyburgers.page.glossary import ORIGIN_RULES

THE_SAME = "the same"
"""Cell of a parameter that a test shares with the first one."""

INTERVALS = (50, 90, 95)
"""Central intervals (%) in which the truth behind synthetic data is looked for."""


def parameter_table(
    summary: pd.DataFrame, priors: PriorSet, fixed: Sequence[Prior] = ()
) -> pd.DataFrame:
    """Return posterior beside prior as text: sampled quantities, then the `fixed` parameters.

    `summary` is that of `Fit.summary` in SI units. With a likelihood there is a column `DECISION`.
    """
    rows = [
        {
            **posterior_row(shown_quantity(str(name)), row.to_dict(), priors.priors.get(str(name))),
            "ESS bulk": f"{row['ess_bulk']:.0f}",
            "ESS tail": f"{row['ess_tail']:.0f}",
            "R-hat": f"{row['rhat']:.3f}",
        }
        for name, row in summary.iterrows()
    ]
    rows += [fixed_row(PARAMETER_BY_NAME[prior.parameter], prior) for prior in fixed]
    return pd.DataFrame(rows).fillna("")


SAMPLER_COLUMNS = ("ESS bulk", "ESS tail", "R-hat")
"""What a `parameter_table` says of the sampler rather than of the parameters."""


def result_table(
    summary: pd.DataFrame, priors: PriorSet, truth: pd.DataFrame | None
) -> pd.DataFrame:
    """Return `parameter_table` without sampler and fixed parameters, with the truth if known."""
    names = [*map(str, summary.index)]
    table = parameter_table(summary, priors).drop(columns=list(SAMPLER_COLUMNS))
    if truth is not None:
        beside = {
            str(name): _truth_beside(shown_quantity(str(name)), row)
            for name, row in truth.iterrows()
        }
        known = pd.DataFrame([beside.get(name, {}) for name in names]).fillna("")
        table = pd.concat([table, known], axis=1)
    return table


LONGEST_NUMBER = 7
"""Characters of a number in a table, if its width does not need more."""

VALUE = "value"
"""Title of the column with `quoted`."""

DECISION = "decided by"
"""Title of the column that says who decides a number (`pyburgers.checks.prior_influence`)."""


def quoted(
    fit: Fit, summary: pd.DataFrame, shown: pd.DataFrame, influences: Mapping[str, Influence]
) -> list[str]:
    """Return what to quote of each row of `Fit.summary` in SI units; `shown` is its `result_table`.

    It is mean ± sd; median and central 90 % where these say more (`is_misled_by_sd`); and the other
    end of the interval, as a limit, at a bound where the model ends.
    """
    law = KELVIN_LAWS[fit.variant.kelvin]
    held = [fit.priors[name] for name in law.conventions if fit.priors[name].is_fixed]
    at = "".join(
        f" (at {fixed['symbol']} = {fixed['mean']} {fixed['unit']})"
        for fixed in (fixed_row(PARAMETER_BY_NAME[prior.parameter], prior) for prior in held)
    )
    texts = []
    for (name, row), cells in zip(summary.iterrows(), shown.to_dict("records"), strict=True):
        bound = influences[str(name)].bound if str(name) in influences else None
        if bound is not None and bound.is_physical:
            is_lower = bound.side == "lower"
            text = f"< {cells['95 %']}" if is_lower else f"> {cells['5 %']}"
        elif is_misled_by_sd(*row[["mean", "sd", "q5", "q95"]]):
            factor = shown_quantity(str(name)).display_factor
            median = float(fit.posterior["posterior"][str(name)].median())
            text = band_text(row["q5"] * factor, median * factor, row["q95"] * factor)
        else:
            text = f"{cells['mean']} ± {cells['sd']}"
        texts.append(text + at * (name in law.redefines))
    return texts


def quoted_or_prior(fit: Fit | None) -> dict[str, str]:
    """Return what is `quoted` of each quantity, or the word prior if its own prior decides it."""
    if fit is None:
        return {}
    summary = fit.summary("SI")
    texts = quoted(fit, summary, result_table(summary, fit.priors, None), fit.decisions())
    decided = [decided_cell(str(name), row.to_dict()) or "" for name, row in summary.iterrows()]
    return {
        str(name): Origin.PRIOR.value if is_own_prior(by) else text
        for name, text, by in zip(summary.index, texts, decided, strict=True)
    }


DOUBTFUL = (Origin.PRIOR, Origin.CONFLICT, Origin.BOUND, Origin.CANNOT_TELL)
"""Who decides a number that the data do not."""


def not_by_data(table: pd.DataFrame) -> dict[str, list[bool]]:
    """Rows of a table that the data do not decide, by its column that says so, if there is one."""
    return {
        name: table[name].str.startswith(DOUBTFUL).tolist() for name in table if name == DECISION
    }


def is_own_prior(decided: str) -> bool:
    """Whether its own prior alone decides a number, be it read off the data or not."""
    return decided.removesuffix(READ_OFF) == Origin.PRIOR


def table_of_deciders() -> pd.DataFrame:
    """Return what the words of that column mean, and the rule behind each, as text."""
    rows = [(origin.value, *told) for origin, told in ORIGIN_RULES.items()]
    return pd.DataFrame(rows, columns=[DECISION, "meaning", "rule"])


def _truth_beside(quantity: Parameter, row: "pd.Series[Any]") -> dict[str, str]:
    """Return the true value in display units, and its distance."""
    factor = quantity.display_factor
    return {
        "truth": rounded(row["truth"] * factor, row["sd"] * factor),
        "off by (sd)": f"{(row['truth'] - row['mean']) / row['sd']:+.2f}",
    }


def truth_sentence(truth: pd.DataFrame) -> str:
    """Say how many of the true values lie inside the central intervals."""
    found = ", ".join(
        f"{int(truth[f'inside_{share}'].sum())} inside {share} %" for share in INTERVALS
    )
    return f"Of {len(truth)} true values {found}."


def posterior_row(
    quantity: Parameter, row: Mapping[Hashable, Any], prior: Prior | None
) -> dict[str, str]:
    """Return what a posterior table in SI units says of a sampled quantity."""
    columns = {"mean": "mean", "sd": "sd", "5 %": "q5", "95 %": "q95"}
    values = {title: float(row[key]) * quantity.display_factor for title, key in columns.items()}
    shown = _with_digits(values)
    decided = decided_cell(quantity.name, row)
    return {
        **named(quantity),
        "mean": shown.pop("mean"),
        "sd": shown.pop("sd"),
        **({} if decided is None else {DECISION: decided}),
        **shown,
        "prior": "implied" if prior is None else prior_text(prior, quantity, with_unit=False),
        "sd / prior sd": "" if prior is None else f"{row['width_beside_prior']:.2f}",
    }


def _with_digits(values: Mapping[str, float]) -> dict[str, str]:
    """Return `rounded` numbers; with two digits what would be 0, and all of them if one is long."""
    sd = values["sd"]
    texts = {title: rounded(value, sd) for title, value in values.items()}
    is_long = max(map(len, texts.values())) > LONGEST_NUMBER and sd > 0.1 * abs(values["mean"])
    return {
        title: f"{value:.2g}" if is_long or (value != 0 and float(text) == 0) else text
        for (title, value), text in zip(values.items(), texts.values(), strict=True)
    }


def decided_cell(name: str, row: Mapping[Hashable, Any]) -> str | None:
    """Say who decides a row of `Fit.summary`; None where the data took no part."""
    if "decided_by" not in row:
        return None
    return decision_text(name, str(row["decided_by"]), str(row["by_prior_of"]))


def fixed_row(parameter: Parameter, prior: Prior) -> dict[str, str]:
    """Return what a posterior table says of a fixed parameter."""
    value = number(prior.location * parameter.display_factor)
    return {**named(parameter), "mean": value, "prior": "fixed"}


def named(quantity: Parameter) -> dict[str, str]:
    """Return symbol, label and display unit."""
    return {
        "symbol": symbol_text(quantity),
        "quantity": quantity.label,
        "unit": unit_text(quantity),
    }


def prior_table(priors: PriorSet) -> pd.DataFrame:
    """Return priors as text: columns symbol, quantity, prior, source."""
    return pd.DataFrame(
        [
            {
                "symbol": symbol_text(PARAMETER_BY_NAME[name]),
                "quantity": PARAMETER_BY_NAME[name].label,
                "prior": prior_text(prior),
                "source": prior.source,
            }
            for name, prior in priors.priors.items()
        ]
    )


def prior_sources(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Gather the sources of several `prior_table`, each once: columns of (symbols), source."""
    columns = pd.DataFrame(columns=["symbol", "source"])
    stacked = pd.concat([columns, *tables], ignore_index=True)
    symbols = stacked.groupby("source", sort=False)["symbol"].agg(
        lambda found: ", ".join(dict.fromkeys(found))
    )
    return pd.DataFrame({"of": symbols.tolist(), "source": symbols.index.tolist()})


def truth_table(fit: Fit) -> pd.DataFrame | None:
    """Compare free parameters (SI) with the known ones behind synthetic data; None without any."""
    truths = fit.experiment.true_parameters
    if truths is None:
        return None
    draws = fit.posterior["posterior"].to_dataset()
    rows = {}
    for name in fit.priors.free:
        if name in truths:
            values = draws[name]
            rows[name] = {
                "unit": shown_quantity(name).si_unit,
                "truth": truths[name],
                "mean": float(values.mean()),
                "sd": float(values.std(ddof=1)),
                **{f"inside_{share}": _inside(values, truths[name], share) for share in INTERVALS},
            }
    columns = ["unit", "truth", "mean", "sd", *(f"inside_{share}" for share in INTERVALS)]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("parameter")


def _inside(values: xr.DataArray, truth: float, share: int) -> bool:
    """Whether a number lies in the central interval that holds `share` % of the draws."""
    low, high = np.quantile(values, [0.5 - share / 200, 0.5 + share / 200])
    return bool(low <= truth <= high)


VERDICT_WORDS = {Outcome.YES: "passed", Outcome.NO: "FAILED", Outcome.CANNOT_TELL: "cannot tell"}


def checks_table(checks: Sequence[CheckResult]) -> pd.DataFrame:
    """Return the verdict of each check in words."""
    return pd.DataFrame(
        [(one.name, VERDICT_WORDS[one.outcome], one.sentence) for one in checks],
        columns=["check", "verdict", "sentence"],
    )


def checks_page_table(title: str, checks: Sequence[CheckResult]) -> PageTable:
    """Return `checks_table` as a part of a page."""
    shown = checks_table(checks)
    return PageTable(
        "checks",
        title,
        shown,
        shown,
        words=("check", "verdict"),
        sentences=("sentence",),
        bad={"verdict": [not one.passed for one in checks]},
    )


def sampler_table(fit: Fit) -> pd.DataFrame:
    """Say what the sampler did: a row for each finished chain, with means and largest values."""
    stats = fit.posterior["sample_stats"].to_dataset()
    rows = []
    for chain in stats["chain"].to_numpy():
        of_chain = stats.sel(chain=chain)
        rows.append(
            {
                "chain": int(chain),
                "wall time (s)": f"{fit.manifest['chains'][str(chain)]['wall_seconds']:.0f}",
                "step size": f"{float(of_chain['step_size'][-1]):.3g}",
                "leapfrog steps (mean)": f"{float(of_chain['n_steps'].mean()):.0f}",
                "tree depth (largest)": int(of_chain["tree_depth"].max()),
                "acceptance (mean)": f"{float(of_chain['acceptance_rate'].mean()):.2f}",
                "divergences": int(of_chain["diverging"].sum()),
            }
        )
    return pd.DataFrame(rows)
