"""Methods of fits in sentences with references, what runs are behind a page, and its manifest."""

import importlib.metadata
import platform
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import pandas as pd

from pyburgers.checks.fit_checks import CheckKind, CheckResult, Outcome
from pyburgers.checks.verdicts import Verdict
from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.common.units import duration_text
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.kinds.stan_data import BDF, FAST
from pyburgers.page.names import alike

_ESCAPED = str.maketrans({letter: f"\\{letter}" for letter in "&%$#_"} | dict.fromkeys("{}\\~^"))
"""Letters that LaTeX reads as commands: escaped, or left out."""

_NO_BRACES = str.maketrans(dict.fromkeys("{}"))

REFERENCES = r"""@misc{burgers_mcmc,
  author = {Maor and Hansen and Jerolmack and Goldsby},
  title = {Learning the nature of viscoelasticity in geologic materials with {MCMC}}
}
@article{stan,
  author = {Carpenter, Bob and Gelman, Andrew and Hoffman, Matthew D. and Lee, Daniel and
    Goodrich, Ben and Betancourt, Michael and Brubaker, Marcus and Guo, Jiqiang and Li, Peter and
    Riddell, Allen},
  title = {{Stan}: A Probabilistic Programming Language},
  journal = {Journal of Statistical Software}, volume = {76}, number = {1}, year = {2017},
  doi = {10.18637/jss.v076.i01}
}
@article{arviz,
  author = {Kumar, Ravin and Carroll, Colin and Hartikainen, Ari and Martin, Osvaldo},
  title = {{ArviZ} a unified library for exploratory analysis of {Bayesian} models in {Python}},
  journal = {Journal of Open Source Software}, volume = {4}, number = {33}, pages = {1143},
  year = {2019}, doi = {10.21105/joss.01143}
}"""
"""The model, the sampler, and what computes R-hat and effective sample sizes."""


def methods_text(
    fit: Fit, checks: Sequence[CheckResult], verdicts: Mapping[CheckKind, Verdict]
) -> str:
    """Say how a fit was made and what its checks found, but for the name of its test."""
    manifest, priors = fit.manifest, fit.priors
    said = [
        f"Laws: {fit.variant.text}.",
        f"Priors: {priors.title} (inputs/priors.toml of the run).",
    ]
    if fit.is_part:
        said.insert(0, f"The fit is of several tests together ({_pooling(manifest, priors.free)}).")
    if not manifest["use_likelihood"]:
        said.insert(0, "The likelihood was switched off: all draws are of the prior.")
    if priors.flow_law:
        source = f": {priors.flow_law.source}" * (priors.flow_law.source not in priors.title)
        said.append(
            f"The priors of n, p, Q_M and beta are a joint one from another source{source}."
        )
    said += _sampling(manifest, fit.posterior["posterior"].sizes["chain"])
    said += [_verdict(verdicts[kind], checks) for kind in CheckKind]
    return " ".join([*said, "R-hat and effective sample sizes are those of ArviZ (arviz)."])


def _pooling(manifest: dict[str, Any], free: Collection[str]) -> str:
    """Say which free parameters the tests of a joint fit have in common, and how."""
    kinds: dict[str, str] = manifest["pooling"]["kinds"]
    named = alike((name for name in kinds if name in free), kinds.__getitem__)
    said = (f"{kind}: {', '.join(names)}" for kind, names in named.items())
    return "; ".join(said).replace("_", " ")


_SOLVERS = {FAST: "Radau IIA of order 5", BDF: "Stan's ode_bdf_tol"}


def _sampling(manifest: dict[str, Any], n_chains: int) -> list[str]:
    """State the settings of the sampler, and what had to be done again."""
    sampler = manifest["sampler"]
    version = manifest["versions"]["cmdstan"] or "of unknown version"
    draws = " + ".join(map(str, [sampler["draws"], *manifest.get("more_draws", [])]))
    said = [
        f"{n_chains} of {sampler['chains']} chains of the no-U-turn sampler of Stan (stan; CmdStan "
        f"{version}) ran with {sampler['warmup']} iterations of warm-up, {draws} draws, seed "
        f"{sampler['seed']}, target acceptance {sampler['adapt_delta']:g} and a tree depth of at "
        f"most {sampler['max_treedepth']}."
    ]
    solver = manifest["solver"]
    said.append(
        f"{_SOLVERS[solver['method']]} solved the equations at a tolerance of "
        f"{solver['tolerance']:.0e}."
    )
    said += [
        f"At tolerance {loose['tolerance']:.0e} of the solver the log density jumped by "
        f"{loose['noise']:.2g} from point to point, too much to sample with."
        for loose in manifest.get("noisy", [])
    ]
    said += [
        f"A first run at tolerance {refit['tolerance']:.0e} was put aside ({refit['chains']}): its "
        f"draws, solved again at the reference tolerance, had Pareto k {refit['pareto_k']:.2f}."
        for refit in manifest.get("refits", [])
    ]
    said += [
        f"Chains with {longer['divergences']} divergences were put aside ({longer['chains']}), and "
        f"went on with shorter steps: {', '.join(longer['step_sizes'])}."
        for longer in manifest.get("shortened", [])
    ]
    if "coordinates" in manifest:
        coordinates = manifest["coordinates"]
        said.append(f"Coordinates: {coordinates['system']} ({coordinates['reason']}).")
    return said


def _verdict(verdict: Verdict, checks: Sequence[CheckResult]) -> str:
    """Answer a question about a fit with the checks behind the answer."""
    made = [one for one in checks if one.check.kind is verdict.kind]
    checked = f" (checks: {', '.join(one.name for one in made)})" if made else ""
    doubted = ", ".join(one.name for one in made if one.outcome is not Outcome.YES)
    return f"{verdict.answer}{checked}{f'; not passed: {doubted}' * bool(doubted)}."


def bibtex(fits: Iterable[SampledFit]) -> str:
    """Return BibTeX entries of measured data, the model, Stan, ArviZ and this software."""
    about = importlib.metadata.metadata("pyburgers")
    software = (
        f"@misc{{pyburgers,\n  author = {{{{The pyburgers developers}}}},\n"
        f"  title = {{pyburgers: {about['Summary']}}},\n  note = {{Version {about['Version']}}}\n}}"
    )
    return "\n".join([*_data_entries(fits), REFERENCES, software])


def _data_entries(fits: Iterable[SampledFit]) -> Iterator[str]:
    """Yield an entry for each source of data that somebody measured."""
    found = {
        (provenance.source, provenance.doi): provenance.kind
        for provenance in (fit.provenance for fit in fits)
        if provenance.kind != "synthetic"
    }
    for number, ((source, doi), kind) in enumerate(found.items(), start=1):
        # As it is: reference managers and biblatex make a link of it.
        doi_text = f"\n  doi = {{{doi.translate(_NO_BRACES)}}}," if doi else ""
        yield (
            f"@misc{{data_{number},\n  title = {{{{{source.translate(_ESCAPED)}}}}},{doi_text}\n"
            f"  note = {{{kind.capitalize()} data}}\n}}"
        )


REPORT_KIND = "pyburgers report"
"""What the manifest of a report says, so that no other manifest is overwritten."""

PACKAGES = ("pyburgers", "arviz", "jinja2", "matplotlib", "numpy", "pandas", "scipy", "xarray")

_OF_A_RUN = {"state": "status", "begun": "started", "fingerprint": "fingerprint"}


def runs_table(named: Sequence[tuple[str, SampledFit]]) -> pd.DataFrame:
    """Say of each fit what no other has: state, beginning, hash, time of all chains, as text."""
    return pd.DataFrame(
        [
            {"fit": name}
            | {title: fit.manifest[key] for title, key in _OF_A_RUN.items()}
            | {"all chains": duration_text(sum(one["wall_seconds"] for one in chains))}
            for name, fit in named
            for chains in (fit.manifest["chains"].values(),)
        ]
    )


def report_manifest(
    named: Sequence[tuple[str, SampledFit]], title: str, command: str
) -> dict[str, Any]:
    """Record what made the report and from what."""
    return {
        "kind": REPORT_KIND,
        "title": title,
        "command": command,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "python": platform.python_version(),
            **{package: importlib.metadata.version(package) for package in PACKAGES},
        },
        "runs": [
            {
                "id": key,
                "directory": fit.directory.path.name,
                "data_kind": fit.provenance.kind,
                "command": fit.manifest["command"],
                "fingerprint": fit.manifest["fingerprint"],
                "status": fit.manifest["status"],
                "manifest_sha256": sha256_of_file(fit.directory.manifest_file),
            }
            for key, fit in named
        ],
    }
