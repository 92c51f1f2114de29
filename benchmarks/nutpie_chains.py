"""Chains of nutpie on the density that CmdStan samples, through the interpreter stanli."""

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Empty, Queue

import arviz as az
import numpy as np
import nutpie
import stanli
from chain_files import read_chain
from nutpie.compiled_pyfunc import from_pyfunc

from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.likelihood import likelihood_of

N_CHAINS = 4
WARMUP = 500
DRAWS = 1000

Density = Callable[[np.ndarray], tuple[float, np.ndarray]]


def density_of(fit: Fit) -> Density:
    """Log density and gradient of a fit's program in its unscaled coordinates, a vector."""
    model = stanli.Model(
        str(likelihood_of(fit.experiment).program),
        data=str(fit.directory.path / "stan_data.json"),
        include_paths=str(stan_directory()),
    )
    return lambda coordinates: model.log_prob_grad(coordinates)


class InOneThread:
    """A density that threads ask for and the main thread answers: stanli fails in other threads."""

    def __init__(self, density: Density) -> None:
        self._density = density
        self._questions: Queue[np.ndarray] = Queue()
        self._answers: Queue[tuple[float, np.ndarray]] = Queue()

    def __call__(self, coordinates: np.ndarray) -> tuple[float, np.ndarray]:
        """Ask from nutpie's only thread."""
        self._questions.put(coordinates)
        return self._answers.get()

    def answer_until(self, ended: Callable[[], bool]) -> None:
        """Answer in this thread."""
        while not ended():
            try:
                coordinates = self._questions.get(timeout=1)
            except Empty:
                continue
            self._answers.put(self._density(coordinates))


def run_nutpie(fit: Fit, seed: int) -> dict[str, float]:
    """Yield and cost of nutpie's chains, which start where those of the fit started."""
    unit = np.array(json.loads(_text(fit, "stan_data.json"))["unit"])
    start = np.array(json.loads(_text(fit, "initial_values/chain_1.json"))["coordinate"]) / unit
    asked = InOneThread(density_of(fit))
    compiled = from_pyfunc(
        ndim=len(start),
        make_logp_fn=lambda: asked,
        make_expand_fn=lambda *_: lambda coordinates: {"coordinate": coordinates},
        expanded_dtypes=[np.dtype(np.float64)],
        expanded_shapes=[(len(start),)],
        expanded_names=["coordinate"],
        make_initial_point_fn=lambda _seed: start,
    )
    with ThreadPoolExecutor(1) as pool:
        sampling = pool.submit(
            nutpie.sample,
            compiled,
            draws=DRAWS,
            tune=WARMUP,
            chains=N_CHAINS,
            cores=1,
            seed=seed,
            progress_bar=False,
        )
        asked.answer_until(sampling.done)
    trace = sampling.result()
    steps = trace.sample_stats["n_steps"]
    warmup = trace.warmup_sample_stats["n_steps"]
    draws = trace.posterior["coordinate"].to_numpy()
    return {
        "leapfrogs_per_draw": float(steps.mean()),
        "draws": float(steps.size),
        "divergences": float(trace.sample_stats["diverging"].sum()),
        "rhat": worst_rhat(draws),
        "ess_bulk": least_ess(draws),
        "ess_per_1000_gradients": 1e3 * least_ess(draws) / float(steps.sum() + warmup.sum()),
    }


def coordinate_ess_per_1000_gradients(fit: Fit) -> float:
    """Least bulk ESS of a fit's coordinates per 1000 gradients, those of the warm-up included."""
    chains = [read_chain(fit.directory.draws_file(c)) for c in fit.directory.finished_chains()]
    columns = [name for name in chains[0].draws if str(name).startswith("coordinate.")]
    draws = np.array([chain.draws[columns].to_numpy() for chain in chains])
    leapfrogs = sum(chain.draws["n_leapfrog__"].sum() for chain in chains)
    # CmdStan does not count the gradients of its warm-up; each costs as much time as later ones.
    with_warmup = 1 + sum(chain.warmup_seconds for chain in chains) / sum(
        chain.sampling_seconds for chain in chains
    )
    return 1e3 * least_ess(draws) / (leapfrogs * with_warmup)


def least_ess(draws: np.ndarray) -> float:
    """Least bulk ESS of draws by chain, draw and coordinate."""
    return min(float(az.ess(draws[..., k])) for k in range(draws.shape[-1]))


def worst_rhat(draws: np.ndarray) -> float:
    """Largest R-hat of draws by chain, draw and coordinate."""
    return max(float(az.rhat(draws[..., k])) for k in range(draws.shape[-1]))


def _text(fit: Fit, name: str) -> str:
    return Path(fit.directory.path, name).read_text(encoding="utf-8")
