"""The whole study in one call: fits of the shipped experiments and the page about them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType

from pyburgers.experiment import Experiment
from pyburgers.experiment_files import load_experiment
from pyburgers.fitting import Fit, fit
from pyburgers.forced_oscillation import load_forced_oscillation, with_background
from pyburgers.oscillation import Background
from pyburgers.priors import default_priors
from pyburgers.report import write_report
from pyburgers.sampling import SamplerOptions
from pyburgers.study import study_sections

PRESETS: Mapping[str, SamplerOptions] = MappingProxyType(
    {
        "quick": SamplerOptions(chains=4, warmup=300, draws=500, seed=1),
        "paper": SamplerOptions(chains=5, warmup=500, draws=3000, seed=1),
    }
)
"""Sampler settings: `paper` has the chains and draws of the paper's Methods."""

ICE_TWINS = ("PIL40", "PIL72", "PIL105")

OLIVINE_RUNS: Mapping[Background, str] = MappingProxyType(
    {"removed": "olivine_removed", "kept": "olivine_kept"}
)
"""Names of the fits of the olivine record by treatment of its background, the paper's first."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What `reproduce` made.

    Attributes
    ----------
    page : Path
        The HTML page.
    fits : tuple of Fit
        The fits it shows.
    """

    page: Path
    fits: tuple[Fit, ...]


def shipped_data_directory() -> Path:
    """Folder of the experiments that come with the package."""
    package = Path(str(files("pyburgers")))
    inside = package / "data"
    return inside if inside.is_dir() else package.parent / "data"


def study_experiments() -> dict[str, Experiment]:
    """Read the shipped experiments of the study, by the names of their runs."""
    data = shipped_data_directory()
    ice = {name: load_experiment(data / "ice" / f"{name}.toml") for name in ICE_TWINS}
    record = load_forced_oscillation(data / "olivine" / "olivine_twin.toml")
    olivine = {
        name: replace(with_background(record, background), id=name)
        for background, name in OLIVINE_RUNS.items()
    }
    return {**ice, **olivine}


def reproduce(preset: str, out: Path, *, command: str, report: Callable[[str], None]) -> Outcome:
    """Fit the experiments of the study and write the page; continue where a call stopped.

    The page has the fits, attenuation as the ice fits predict it, what the treatment of the
    olivine record changes, and the paper's statements.

    Parameters
    ----------
    preset : str
        A key of `PRESETS`.
    out : Path
        Folder of the page; the runs go into its subfolder ``runs``.
    command : str
        Command that regenerates the page, for the manifests.
    report : callable
        Receives progress sentences.
    """
    experiments = study_experiments()
    fits = {}
    for number, (name, experiment) in enumerate(experiments.items(), start=1):
        report(f"Fit {number} of {len(experiments)}: {name}, preset {preset}.")
        fits[name] = fit(
            experiment,
            default_priors(experiment.material),
            out=out / "runs" / preset / name,
            options=PRESETS[preset],
            command=command,
            report=report,
        )
    ice_fits = {name: fits[name] for name in ICE_TWINS}
    olivine_fits: dict[str, Fit] = {
        background: fits[name] for background, name in OLIVINE_RUNS.items()
    }
    page = write_report(
        list(fits.values()),
        out,
        title=f"Nonlinear Burgers fits of ice and olivine ({preset} preset)",
        command=command,
        report=report,
        extras=study_sections(ice_fits, olivine_fits, report=report),
    )
    return Outcome(page=page, fits=tuple(fits.values()))
