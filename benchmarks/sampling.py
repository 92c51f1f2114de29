"""Effective draws per second: the paper's six-state form, plain and the product's coordinates.

Fits every test with the product (its own and plain coordinates) and runs the paper's form beside
it for a bounded time, one after the other on the same machine. Writes a table, a figure, and a
description of the machine:

    python benchmarks/sampling.py            # everything, about 35 minutes on two cores
    python benchmarks/sampling.py PIL40      # some tests; the rows of the others stay
"""

import argparse
import json
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import psutil
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from measures import coordinate_ess_per_1000_gradients, grain_size_share, measure
from processes import MIB, run_together
from six_state import N_CHAINS, USUAL_LENGTH, WARMUP, WARMUP_SECONDS, run_baseline
from tables import ICE, RESULTS, ROOT, markdown

from pyburgers import Fit, OscillationExperiment, load_program, with_background
from pyburgers.cmdstan.toolchain import find_cmdstan, toolchain
from pyburgers.common.messages import messages_to
from pyburgers.drawing.style import BLUE, GREY, ORANGE
from pyburgers.kinds.forced_oscillation.preparation import Background
from pyburgers.kinds.kind import load_experiment, save_experiment
from pyburgers.kinds.likelihood import likelihood_of

DUNITE = ROOT / "data" / "dunite"
OLIVINE = ROOT / "data" / "olivine" / "olivine_twin.toml"
TESTS = {
    "PIL40": ICE / "PIL40.toml",
    "PIL72": ICE / "PIL72.toml",
    "PIL105": ICE / "PIL105.toml",
    "4506": DUNITE / "dunite_4506.toml",
    "4581": DUNITE / "dunite_4581.toml",
    "olivine_kept": OLIVINE,
    "olivine_removed": OLIVINE,
}
PICTURED = "PIL40"
MEASURED = {"4506", "4581"}

PLAIN = ("--chains", "2", "--warmup", "200", "--draws", "200", "--coordinates", "plain")
BASELINE_SECONDS = 180.0


def main() -> None:
    """Run the benchmark and write its results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tests", nargs="*", metavar="TEST", choices=[[], *TESTS])
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.tests or TESTS:
        with tempfile.TemporaryDirectory() as scratch:
            rows = _measure(name, Path(scratch), options.out, options.seed)
        print(rows.to_string(), flush=True)
        table = _merged(rows, options.out / "sampling.csv")
        table.to_csv(options.out / "sampling.csv", float_format="%.4g")
    machine = _machine()
    (options.out / "machine.json").write_text(json.dumps(machine, indent=1) + "\n")
    (options.out / "sampling.md").write_text(_page(table, machine), encoding="utf-8")
    _figure(table).savefig(options.out / "sampling.png", dpi=130)


def _measure(name: str, scratch: Path, out: Path, seed: int) -> pd.DataFrame:
    """Rows of one test, one form after the other."""
    file = _experiment_file(name, scratch)
    product, row = _product(name, "product", file, (), scratch / "product", seed)
    if name == PICTURED:
        _valley_picture(product).savefig(out / "valley.png", dpi=130)
    _, plain = _product(name, "plain", file, PLAIN, scratch / "plain", seed)
    baseline = run_baseline(
        product, scratch / "six_state", limit_seconds=BASELINE_SECONDS, seed=seed
    )
    rows = [row, plain, {"test": name, "form": "six states", **baseline}]
    return pd.DataFrame(rows).set_index(["test", "form"])


def _merged(rows: pd.DataFrame, file: Path) -> pd.DataFrame:
    """Put the rows in the place of those of the same test in a table written before."""
    if file.is_file():
        before = pd.read_csv(file, dtype={"test": str}).set_index(["test", "form"])
        kept = before.drop(rows.index.unique("test"), level="test", errors="ignore")
        rows = pd.concat([kept, rows])
    order = [name for name in TESTS if name in rows.index.unique("test")]
    return rows.loc[order]


def _experiment_file(name: str, scratch: Path) -> Path:
    """File of a test, the program for it compiled; the two treatments of olivine share a record."""
    experiment = load_experiment(TESTS[name])
    with messages_to(sys.stdout):
        load_program(likelihood_of(experiment).program)
    if not isinstance(experiment, OscillationExperiment):
        return TESTS[name]
    background: Background = "kept" if name == "olivine_kept" else "removed"
    folder = scratch / "inputs"
    folder.mkdir()
    return save_experiment(with_background(experiment, background), folder)


def _product(
    name: str, form: str, file: Path, settings: tuple[str, ...], folder: Path, seed: int
) -> tuple[Fit, dict[str, Any]]:
    """Fit through the command line, as a user does, and read the run directory."""
    command = [sys.executable, "-m", "pyburgers", "fit", str(file), "--out", str(folder)]
    cost = run_together([[*command, "--seed", str(seed), *settings]])
    fit = Fit.load(folder)
    got = measure(fit)
    with_warmup = got.sampling_seconds + got.warmup_seconds
    return fit, {
        "test": name,
        "form": form,
        "ms_per_gradient": 1e3 * got.sampling_seconds / got.leapfrogs,
        "leapfrogs_per_draw": got.leapfrogs / got.draws,
        "step_size_ratio": got.step_size_ratio,
        "draws": got.draws,
        "divergences": got.divergences,
        "rhat": got.rhat,
        "ess_bulk": got.ess_bulk,
        "ess_tail": got.ess_tail,
        "ess_bulk_per_s": got.ess_bulk / got.sampling_seconds,
        "ess_tail_per_s": got.ess_tail / got.sampling_seconds,
        "ess_bulk_per_s_with_warmup": got.ess_bulk / with_warmup,
        "ess_per_1000_gradients": coordinate_ess_per_1000_gradients(fit),
        "ess_tail_per_s_with_warmup": got.ess_tail / with_warmup,
        "s_per_draw": got.sampling_seconds / got.draws,
        "wall_s": cost.wall_seconds,
        "peak_MiB": cost.peak_bytes / MIB,
    }


def _machine() -> dict[str, Any]:
    found = find_cmdstan()
    if found is None:
        raise SystemExit("CmdStan is missing; run pyburgers install-cmdstan.")
    tools = toolchain(found)
    models = [
        line.split(":", 1)[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": psutil.cpu_count(),
        "memory_GiB": round(psutil.virtual_memory().total / 2**30),
        "system": platform.system(),
        "python": platform.python_version(),
        "cmdstan": tools.cmdstan_version,
        "compiler": tools.compiler,
    }


COLUMNS = {
    "ms_per_gradient": "ms per gradient",
    "leapfrogs_per_draw": "leapfrogs per draw",
    "step_size_ratio": "smallest/largest step",
    "divergences": "divergences",
    "draws": "draws",
    "rhat": "R-hat",
    "ess_bulk": "bulk ESS",
    "ess_tail": "tail ESS",
    "ess_bulk_per_s": "bulk ESS/s",
    "ess_bulk_per_s_with_warmup": "bulk ESS/s with warm-up",
    "ess_bulk_per_s_median": "median ESS/s",
    "ess_per_1000_gradients": "ESS of coordinates per 1000 gradients",
    "wall_s": "wall s",
    "peak_MiB": "peak MiB",
}

EXPLANATION = """# Sampling benchmark

Written by `make bench`; do not edit. PIL40, PIL72 and PIL105 are synthetic tests, 4506 and 4581
measured dunite, olivine_kept and olivine_removed one synthetic oscillation record with its
background kept and removed. The product samples tests at constant rate in valley coordinates and
oscillations in sheared ones. Effective sample sizes (ESS) are the least over the sampled
quantities, per second of one core.

![Leapfrog steps per draw and effective draws per second, by form](sampling.png)

## Ratios of the product to the six-state form

{ratios}

A blank row: CVODES cannot start the sensitivities of the six-state form after a rate step at the
default tolerance. A row with gradients alone: that form did not get through {warmup} iterations of
step-size adaptation and two draws in {seconds:.0f} s.

The six-state row is extrapolated from a run stopped after {seconds:.0f} s: {chains} chains side by
side that start at posterior draws with the dense metric of the posterior, and adapt their step
size for {warmup} iterations. Effective draws per draw come from the mean squared jump of each
parameter against its posterior variance, as of a first-order autoregressive chain, for the slowest
parameter; "median ESS/s" is that of the median parameter. With warm-up: as many warm-up iterations
as draws ({length} each), at the pace of the first {warmup_seconds:.0f} s of chains with CmdStan's
defaults that start at posterior draws too. Both choices favour the six-state form.

The plain row has 2 chains of 200 + 200 iterations; memory is that of all processes together.

`sampling.csv` has more columns.

## Table

{table}

## Machine

{machine}
"""


def _page(table: pd.DataFrame, machine: dict[str, Any]) -> str:
    """Table in Markdown, ratios first."""
    ratios = []
    for name in table.index.unique("test"):
        product, paper = table.loc[(name, "product")], table.loc[(name, "six states")]
        ratios.append(
            {
                "test": name,
                "bulk ESS/s": product["ess_bulk_per_s"] / paper["ess_bulk_per_s"],
                "with warm-up": product["ess_bulk_per_s_with_warmup"]
                / paper["ess_bulk_per_s_with_warmup"],
                "gradients per second": paper["ms_per_gradient"] / product["ms_per_gradient"],
                "fewer leapfrogs per draw": paper["leapfrogs_per_draw"]
                / product["leapfrogs_per_draw"],
            }
        )
    shown = table.reindex(columns=list(COLUMNS)).rename(columns=COLUMNS)
    return EXPLANATION.format(
        ratios=markdown(pd.DataFrame(ratios)),
        seconds=BASELINE_SECONDS,
        chains=N_CHAINS,
        warmup=WARMUP,
        length=USUAL_LENGTH,
        warmup_seconds=WARMUP_SECONDS,
        table=markdown(shown.reset_index()),
        machine="\n".join(f"- {key}: {value}" for key, value in machine.items()),
    )


def _figure(table: pd.DataFrame) -> Figure:
    """Leapfrogs for each draw, and effective draws for each second, by form."""
    figure = Figure(figsize=(11.5, 4.4), layout="constrained")
    axes = figure.subplots(1, 2)
    _bars(axes[0], table, "leapfrogs_per_draw", "Leapfrog steps per draw")
    _bars(
        axes[1],
        table,
        "ess_bulk_per_s_with_warmup",
        "Least bulk ESS per core-second (1/s),\nwarm-up included",
    )
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _valley_picture(fit: Fit) -> Figure:
    """Draws in the plane of the critical strains, by density and by what softens."""
    draws = fit.posterior["posterior"].to_dataset()
    density = fit.posterior["log_likelihood"]["stress"].sum("point")
    density = density + fit.posterior["log_prior"]["lprior"]
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    colours = {
        "log posterior density below its largest": (density - density.max()).clip(min=-15),
        "share of grain size in the softening": grain_size_share(fit.posterior).clip(0, 1),
    }
    order = np.argsort(density.to_numpy().ravel())
    for axis, (label, values) in zip(axes, colours.items(), strict=True):
        points = axis.scatter(
            draws["critical_strain_grain_size"].to_numpy().ravel()[order],
            draws["critical_strain_fabric"].to_numpy().ravel()[order],
            c=values.to_numpy().ravel()[order],
            s=4,
            cmap="cividis",
        )
        figure.colorbar(points, ax=axis, label=label)
        axis.set_xlabel("critical strain of grain size ε_c1 (1)")
    axes[0].set_ylabel("critical strain of fabric ε_c2 (1)")
    figure.suptitle(f"{fit.experiment.id} (synthetic): {draws['beta'].size} draws", fontsize=11)
    return figure


def _bars(axes: Axes, table: pd.DataFrame, column: str, label: str) -> None:
    forms = {"six states": (GREY, "six states (extrapolated)"), "plain": (ORANGE, "plain"),
             "product": (BLUE, "product")}  # fmt: skip
    names = list(table.index.unique("test"))
    for k, (form, (colour, text)) in enumerate(forms.items()):
        heights = [table[column].get((name, form), np.nan) for name in names]
        axes.bar(np.arange(len(names)) + 0.27 * (k - 1), heights, 0.25, color=colour, label=text)
    axes.set_yscale("log")
    kinds = ["measured" if name in MEASURED else "synthetic" for name in names]
    axes.set_xticks(
        range(len(names)),
        ["\n".join([*name.split("_"), kind]) for name, kind in zip(names, kinds, strict=True)],
        fontsize=8,
    )
    axes.set_ylabel(label)
    axes.grid(axis="y", alpha=0.3)


if __name__ == "__main__":
    main()
