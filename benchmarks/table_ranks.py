"""Rank true values in fits of simulated tables of rates (python benchmarks/table_ranks.py OUT).

A data set has the conditions of measured tables of ice, or made-up ones of wet olivine. Its law,
its sources and what was read are drawn from the priors. The fit has default options. Rows of data
sets that are in the files of OUT already stay, so the same command goes on. Synthetic throughout.
"""

from collections.abc import Sequence
from dataclasses import replace
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from growing_tables import Key, Row, grow, parser_of
from tables import ICE, markdown, verdict_table

from pyburgers import Outcome, SamplerOptions, SamplingError, fit_rates, load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.atomic_files import write_text
from pyburgers.common.draws import all_draws, evenly_spaced
from pyburgers.flow_law_tables.laws import RateLaw, rate_law
from pyburgers.flow_law_tables.program_data import law_for, rate_data
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import RateTable, joined
from pyburgers.kinds.experiment import Provenance
from pyburgers.sbc.rank_uniformity import VERDICTS_TEXT

TABLES = {
    "ice_power_law": ("fan_2020", "qi_2017", "jacka_1984_minimum"),
    "ice_composite": ("goldsby_kohlstedt_1997",),
    "olivine_wet": (),
}
"""Measured tables whose conditions data sets of a law have; none: made-up ones."""

N_RANKED = 99
"""Draws of a fit among which the truth is ranked, evenly spaced."""

SYNTHETIC = Provenance("synthetic", "drawn from the priors of a law")


def main() -> None:
    """Fit what is missing; write tables and page after each data set."""
    parser = parser_of(__doc__, range(200))
    parser.add_argument("--law", choices=[*TABLES], required=True)
    options = parser.parse_args()
    tasks: dict[Key, Sequence[object]] = {(seed,): (options.law, seed) for seed in options.seeds}
    file = options.out / f"table_ranks_{options.law}.csv"

    def write_page(rows: pd.DataFrame) -> None:
        write_text(file.with_suffix(".md"), page(options.law, rows))

    grow(file, ("seed",), rank_one, tasks, options.jobs, write_page)


def rank_one(name: str, seed: int) -> Row:
    """Simulate and fit one data set; return verdict and ranks."""
    data = conditions(name)
    law = law_for(data, rate_law(name))
    rng = np.random.default_rng([seed, 11])
    truth = {one: prior.sample(rng) for one, prior in law.priors.priors.items()}
    with TemporaryDirectory() as folder:
        options = SamplerOptions(seed=seed, parallel_chains=1)
        try:
            simulated = read_at(data, law.at(**truth), rng)
            fit = fit_rates(simulated, rate_law(name), out=folder, options=options)
        except SamplingError as error:
            return {"seed": seed, "sampled_well": Outcome.NO.value, "failure": str(error)}
        well = fit.sampled_well
        draws = fit.posterior["posterior"].to_dataset()
        ranks = {
            one: float((evenly_spaced(all_draws(draws[one]), N_RANKED) < truth[one]).sum())
            for one in law.priors.free
        }
    return {"seed": seed, "sampled_well": well.value, "failure": "", **ranks}


def conditions(name: str) -> RateTable:
    """Return the conditions of the data sets of a law; what was read is still to be made."""
    tables = [load_rate_table(ICE / "rates" / f"{one}.toml") for one in TABLES[name]]
    if tables:
        return replace(joined(tables), provenance=SYNTHETIC)
    rng, n_rows = np.random.default_rng(6), 80
    kelvin = rng.uniform(1400.0, 1600.0, n_rows)
    columns = {
        "temperature": kelvin,
        "stress": 10 ** rng.uniform(6.7, 8.7, n_rows),
        "strain_rate": np.full(n_rows, 1e-6),
        "grain_size": 10 ** rng.uniform(-5.5, -3.5, n_rows),
        "pressure": rng.uniform(1e8, 4e9, n_rows),
        "water_fugacity": 10 ** rng.uniform(7.0, 10.0, n_rows),
        "melt_fraction": rng.uniform(0.0, 0.1, n_rows),
    }
    units = dict(zip(columns, ("K", "Pa", "1/s", "m", "Pa", "Pa", "fraction"), strict=True))
    return load_rate_table(
        {
            "id": name,
            "material": "olivine",
            "protocol": "rates",
            "data": {
                "file": columns,
                **{f"{one}_column": one for one in columns},
                **{f"{one}_unit": unit for one, unit in units.items()},
            },
            "tests": [{"imposed": "stress", "regime": "minimum", "geometry": "compression"}],
            "provenance": {"kind": "synthetic", "source": SYNTHETIC.source},
        }
    )


def read_at(data: RateTable, exact: RateLaw, rng: np.random.Generator) -> RateTable:
    """Put what is read by a law without free parameters in the place of what was read."""
    n_sources = len(data.sources) if len(data.sources) > 1 else 0
    position = {
        f"{one}_coordinate": rng.standard_normal(n_sources).tolist()
        for one in ("rate", "temperature", "scatter")
    }
    made = load_program(stan_directory() / "rates.stan").evaluate(
        {**rate_data(data, exact), "centring": [0.0] * len(data.sources)},
        {"coordinate": [], "softening_coordinate": [], **position},
        seed=int(rng.integers(2**31)),
    )
    read = np.exp(made["log_read_replicated"])
    return replace(
        data,
        stress=np.where(data.stress_is_imposed, data.stress, read),
        strain_rate=np.where(data.stress_is_imposed, read, data.strain_rate),
    )


def page(name: str, rows: pd.DataFrame) -> str:
    """Return counts and verdicts of a law as Markdown."""
    well = rows[rows["sampled_well"] == Outcome.YES.value]
    names = [*rows.columns.drop(["seed", "sampled_well", "failure"])]
    ranks = {one: well[one].astype(int).tolist() for one in names}
    table = verdict_table(ranks, N_RANKED)
    of_tables = ", ".join(TABLES[name]) or "80 made-up tests"
    return PAGE.format(
        law=name,
        tables=of_tables,
        ranked=len(well),
        fits=len(rows),
        table=markdown(table),
        verdicts=VERDICTS_TEXT,
    )


PAGE = """# Ranks of true values in tables of rates, law {law}

Written by `benchmarks/table_ranks.py`; do not edit. All data are synthetic: the conditions of
{tables}, the law and readings drawn from the priors. {ranked} of {fits} default fits are sampled
well and ranked.

{table}

{verdicts}
"""


if __name__ == "__main__":
    main()
