"""What the manifest of a run holds, checked on reading: users may have touched it."""

import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Literal

from pydantic import ConfigDict, Field

from pyburgers.common.atomic_files import sha256_of_json
from pyburgers.common.toml_files import Table
from pyburgers.sampling.options import options_table

COMPLETE = "complete"
"""Status of a run that lacks nothing."""

SEAL = "seal"
"""Entry of a manifest: the hash of all others. Only manifests without a `FORMAT` may lack it."""

FORMAT = "format"
"""Entry of a manifest: the number of its format, which manifests of earlier versions lack."""

SEALED_FORMAT = 2
"""Format of the manifests that are written: with a seal."""


class Entries(Table):
    """Entries of which those named here are read back; there may be others, and infinities."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=True)


class ChainRecord(Entries):
    """A finished chain; also in its own folder."""

    wall_seconds: float = Field(description="how long the chain took, in s")
    sha256: str = Field(description="hash of its draws.csv")
    extension: int = Field(0, ge=0, description="how often the chain was extended")


class RecordedHashes(Entries):
    """Hashes of files that nobody may change after a run."""

    hashes: dict[str, str] = Field({}, description="hash of each input file, by its path")
    chains: dict[str, ChainRecord] = Field({}, description="record of each finished chain")
    posterior_sha256: str | None = Field(None, description="hash of posterior.nc")

    def draws_hash(self, chain: int, extension: int) -> str | None:
        """Return the hash that is noted of a chain's draws up to an extension, if it is."""
        record = self.chains.get(str(chain))
        # A run that was killed after it had extended its chains has noted the old.
        return record.sha256 if record is not None and record.extension == extension else None


if TYPE_CHECKING:
    SamplerRecord = Table
else:
    SamplerRecord = options_table(settled=True)


class _Solver(Entries):
    tolerance: float = Field(gt=0, description="of the solver")
    max_num_steps: int = Field(ge=1, description="of the solver")
    method: str = Field(description="which solver: fast, or Stan's ode_bdf_tol")


class ChainFailure(Table):
    """A chain that did not finish: what ended it, where, and what to try."""

    chain: int = Field(description="identifier of a chain")
    reason: str = Field(description="what ended it")
    by_system: bool = Field(
        default=False, description="whether it may end well when it is tried again"
    )


class _Refit(Entries):
    tolerance: float = Field(description="of the solver")
    pareto_k: float = Field(description="of the draws that were put aside")
    chains: str = Field(description="the folder where they are")


class _Coordinates(Entries):
    system: str = Field(description="name of the coordinates")
    reason: str = Field(description="why these")


class _Shortened(Entries):
    divergences: int = Field(ge=1, description="of the draws that were put aside")
    chains: str = Field(description="the folder where they are")
    step_sizes: dict[str, float] = Field(description="step that each chain goes on with")


class NoisyTolerance(Entries):
    """A tolerance of the solver that is too loose, and the noise of the log density there."""

    tolerance: float = Field(description="of the solver")
    noise: float = Field(description="of the log density at that tolerance")


class OtherMode(Entries):
    """Another mode of a problem than the one that chains start from."""

    log_weight: float = Field(description="ln of its weight over that where chains start")
    values: dict[str, dict[str, float]] = Field(description="free parameters, by tests")


class PoolingRecord(Entries):
    """A `pyburgers.model.pooling.Pooling`."""

    kinds: dict[str, str] = Field(description="how each parameter is pooled")
    spread_scales: dict[str, float] = Field(description="scale of the spread of some of them")


class RunManifest(RecordedHashes):
    """Of a run of chains, as far as it is read back."""

    fingerprint: str = Field(description="hash of what decides the draws")
    status: Literal[
        "claimed",
        "sampling",
        "interrupted",
        "sampled",
        "chains missing",
        "extension failed",
        "complete",
    ] = Field(description="how far the run has come")
    experiment: str = Field(description="what was fitted")
    data_kind: Literal["measured", "digitised", "synthetic"] = Field(
        description="where the data come from"
    )
    command: str = Field(description="what regenerates the run")
    started: str = Field(description="when the run was begun")
    versions: dict[str, str | None] = Field(description="versions of the software")
    hashes: dict[str, str] = Field(description="hash of each input file, by its path")
    sampler: SamplerRecord = Field(description="settings of the sampler")
    use_likelihood: bool = Field(description="whether data took part")
    failures: list[ChainFailure] = Field(description="chains that did not finish")
    shortened: list[_Shortened] = Field(
        [], description="runs that were put aside for their divergences"
    )


class FitManifest(RunManifest):
    """Of a fit of one or several tests."""

    experiments: list[str] = Field(min_length=1, description="names of the tests")
    priors_from: str | None = Field(None, description="another source of the flow law's priors")
    pooling: PoolingRecord = Field(description="what tests share")
    variant: dict[str, str] = Field(description="law of each part of the model")
    solver: _Solver = Field(description="settings of the solver")
    more_draws: list[int] = Field([], description="draws by which chains were extended")
    noisy: list[NoisyTolerance] = Field(
        [], description="tolerances that were too loose to sample with"
    )
    refits: list[_Refit] = Field(description="runs that were put aside")
    coordinates: _Coordinates = Field(description="coordinates of the sampler")
    other_modes: list[OtherMode] = Field([], description="modes that chains do not start from")


def recorded_modes(manifest: Mapping[str, Any], part: str | None) -> tuple[OtherMode, ...]:
    """Return the other modes that the manifest of a run notes, of one of its tests or all."""
    noted = (OtherMode.model_validate(one) for one in manifest.get("other_modes", []))
    if part is None:
        return tuple(noted)
    return tuple(one.model_copy(update={"values": {part: one.values[part]}}) for one in noted)


def missing_chains(
    finished: Iterable[int], manifest: Mapping[str, Any]
) -> tuple[ChainFailure, ...]:
    """Return the chains that a run was asked for and does not have, and why."""
    noted = {
        failure["chain"]: ChainFailure.model_validate(failure) for failure in manifest["failures"]
    }
    missing = set(range(1, manifest["sampler"]["chains"] + 1)) - set(finished)
    return tuple(noted.get(chain) or _stopped(chain) for chain in sorted(missing))


def _stopped(chain: int) -> ChainFailure:
    """Return a chain of which nothing is noted."""
    return ChainFailure(
        chain=chain,
        reason=f"Chain {chain} has not run to its end because the run was stopped; run the same "
        "command again: it runs only the missing chains.",
    )


def sealed(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return a manifest with its format, and its seal: the hash of all else as it is read back."""
    content = {**manifest, FORMAT: SEALED_FORMAT}
    content.pop(SEAL, None)
    return {**content, SEAL: sha256_of_json(json.loads(json.dumps(content)))}
