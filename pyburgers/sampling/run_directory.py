"""The run directory: where every file of a fit lives, written so that a kill leaves no half file.

Files are written beside their final name and renamed over it; a chain's folder is filled under
``.scratch`` and renamed into place as a whole. What is under ``.scratch`` is never read, nor are
files whose name starts with `UNFINISHED`; both are removed when the run is continued. The hashes
that a run notes, and the seal of its manifest, tell what was changed since by hand or by accident,
not what a forger changed who mends every hash.
"""

import re
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyburgers.common.atomic_files import (
    UNFINISHED,
    copy_and_hash,
    flush_to_disk,
    is_unfinished,
    sha256_of_file,
    write_json,
)
from pyburgers.common.errors import InputError, StructureError
from pyburgers.common.locks import process_lock
from pyburgers.common.scratch import scratch_folder
from pyburgers.common.toml_files import TableT, checked, read_json, read_json_table
from pyburgers.sampling.manifest import FORMAT, SEAL, ChainRecord, RecordedHashes, sealed

PATIENCE = 120.0
"""How long a process that shares a directory waits for the others (s)."""

FOLDERS = ("inputs", "initial_values", "chains")
"""Folders of the run directory of a fit."""

RESULTS = (
    *("posterior.nc", "summary.csv", "checks.json"),
    *("flow_law_prior.json", "flow_law.png", "flow_law.svg"),
)
"""What is made of the draws of a fit."""

WRITTEN = frozenset(
    {*FOLDERS, *RESULTS, "failures", "leave_out", "superseded", ".scratch"}
    | {"stan_data.json", "metric.json"}
)
"""What a fit writes into its run directory beside its manifest."""

REMEDY = (
    "put back what the run wrote, or remove the directory and run the command in its manifest "
    "again, then with --more-draws for each number of its list more_draws (without posterior.nc "
    "it is gathered again, without a folder in chains/ that chain is run again)"
)
"""What to do about a file that is not as the run wrote it."""


class _Place:
    """A file or folder of every run, by its path in the run directory."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, run: "RunDirectory", _: object) -> Path:
        """Return where it is in a run."""
        return run.path / self._name


@dataclass(frozen=True)
class RunDirectory:
    """Files of one run below its `path`, what it notes of them, and who may write them."""

    path: Path

    # Command, seeds, versions, hashes, wall times, status.
    manifest_file = _Place("manifest.json")
    # Self-contained copies of tests and priors.
    inputs = _Place("inputs")
    # Copy of the priors, as given.
    priors_file = _Place("inputs/priors.toml")
    # Data that every chain read.
    stan_data_file = _Place("stan_data.json")
    # First metric of the sampler; absent where it starts from the unit metric.
    metric_file = _Place("metric.json")
    # Labelled draws.
    posterior_file = _Place("posterior.nc")
    # Verdicts of the checks.
    checks_file = _Place("checks.json")
    # Posterior table.
    summary_file = _Place("summary.csv")
    _scratch = _Place(".scratch")

    def test_file(self, name: str) -> Path:
        """Copy of a test."""
        return self.inputs / "tests" / name / "experiment.toml"

    def initial_values_file(self, chain: int) -> Path:
        """Start of one chain."""
        return self.path / "initial_values" / f"chain_{chain}.json"

    def chain_folder(self, chain: int) -> Path:
        """Folder of one finished chain; it exists only when the chain is complete."""
        return self.path / "chains" / f"chain_{chain}"

    def extended_folder(self, chain: int, extension: int) -> Path:
        """Folder of a finished chain with its draws up to an extension (0: as it first ended)."""
        folder = self.chain_folder(chain)
        return folder / f"extended_{extension}" if extension else folder

    def draws_file(self, chain: int, extension: int = 0) -> Path:
        """CmdStan's CSV of one finished chain."""
        return self.extended_folder(chain, extension) / "draws.csv"

    def draws_files(self) -> list[Path]:
        """Those of all finished chains, in order, with the draws that all of them have."""
        extension = self.n_extensions()
        return [self.draws_file(chain, extension) for chain in self.finished_chains()]

    def timing_file(self, chain: int, extension: int = 0) -> Path:
        """Wall time of one finished chain and hash of its draws."""
        return self.extended_folder(chain, extension) / "timing.json"

    def n_extensions(self) -> int:
        """Return how often all finished chains were extended."""
        extension, chains = 0, self.finished_chains()
        while chains and all(self.extended_folder(one, extension + 1).is_dir() for one in chains):
            extension += 1
        return extension

    def failure_file(self, chain: int) -> Path:
        """Console of the last failed attempt at one chain."""
        return self.path / "failures" / f"chain_{chain}.txt"

    def finished_chains(self) -> tuple[int, ...]:
        """Return the identifiers of the chains that are complete, in order."""
        folder = self.path / "chains"
        try:
            names = [entry.name for entry in folder.iterdir()]
        except FileNotFoundError:
            return ()
        except OSError as error:  # that does not mean that there are none
            raise InputError(f"{folder}: cannot be read ({error.strerror}).") from error
        found = (re.fullmatch(r"chain_([1-9]\d{0,5})", name) for name in names)
        return tuple(sorted(int(name[1]) for name in found if name is not None))

    def require_a_chain(self) -> None:
        """Raise `InputError` if no chain is complete, so that there are no draws to read."""
        if not self.finished_chains():
            known = self.read_manifest()
            which = "command in its manifest" if "command" in known else "same command"
            raise InputError(
                f"{self.path}: no chain is finished yet (status {known.get('status')!r}); run the "
                f"{which} again to complete it."
            )

    def read_manifest(self, structure: type[TableT] | None = None) -> dict[str, Any]:
        """Read the manifest, and check that it holds a `structure` if one is given."""
        if not self.manifest_file.is_file():
            raise InputError(
                f"{self.path}: not a run directory, expected a folder that holds manifest.json."
            )
        manifest = read_json(self.manifest_file)
        if {SEAL, FORMAT} & manifest.keys() and manifest != sealed(manifest):
            seal = "seal" if SEAL in manifest else "missing seal"
            raise InputError(
                f"{self.manifest_file} has changed since the run, as its {seal} says; put back "
                "what the run wrote, or remove the directory and fit again."
            )
        if structure is not None:
            try:
                checked(self.manifest_file, manifest, structure)
            except StructureError as error:
                raise InputError(
                    f"{error} If another version of pyburgers wrote the folder, use that version."
                ) from None
        return manifest

    def update_manifest(self, changes: Mapping[str, Any]) -> None:
        """Merge `changes` into the manifest's top level."""
        current = self.read_manifest() if self.manifest_file.is_file() else {}
        self.write_manifest({**current, **changes})

    def write_manifest(self, content: Mapping[str, Any]) -> None:
        """Write the whole manifest with its format and its seal."""
        write_json(self.manifest_file, sealed(content))

    def read_stan_data(self) -> dict[str, Any]:
        """Read the data that every chain read."""
        return read_json(self.stan_data_file)

    def hashes(self, files: Sequence[Path]) -> dict[str, str]:
        """Return the hashes of files in the directory, by their paths in it."""
        return {file.relative_to(self.path).as_posix(): sha256_of_file(file) for file in files}

    def note_hash(self, file: Path) -> None:
        """Note the hash of a file that was written after the chains and will be read back."""
        noted = self.read_manifest().get("hashes", {})
        self.update_manifest({"hashes": {**noted, **self.hashes([file])}})

    def chain_record(self, chain: int, extension: int) -> ChainRecord:
        """Read what a finished chain noted; raise `InputError` if it is missing or damaged."""
        try:
            return read_json_table(self.timing_file(chain, extension), ChainRecord)
        except InputError as error:
            raise InputError(f"{str(error).rstrip('.')}; {REMEDY}.") from error

    def chain_records(self) -> dict[str, dict[str, Any]]:
        """Return `chain_record` of every finished chain, by its identifier as text."""
        extension, chains = self.n_extensions(), self.finished_chains()
        return {str(one): self.chain_record(one, extension).model_dump() for one in chains}

    def require_unchanged(self) -> None:
        """Raise `InputError`, which names them all, if files differ from the noted hashes."""
        self._compare(self.read_manifest(), sha256_of_file)

    @contextmanager
    def unchanged_copy(
        self, manifest: Mapping[str, Any], *, with_draws: bool = False
    ) -> Iterator["RunDirectory"]:
        """Give a private copy of the noted files, of the bytes whose hash was compared.

        Whoever reads the copy reads nothing that came into the directory after the comparison with
        the hashes in `manifest`. The chains are only compared unless `with_draws` asks for them.
        """
        with scratch_folder() as folder:
            copy = RunDirectory(folder)
            chains = self.path / "chains"

            def hash_of(file: Path) -> str:
                if file == self.posterior_file or (chains in file.parents and not with_draws):
                    return sha256_of_file(file)
                return copy_and_hash(file, copy.path / file.relative_to(self.path))

            self._compare(manifest, hash_of)
            yield copy

    def _compare(self, manifest: Mapping[str, Any], hash_of: Callable[[Path], str]) -> None:
        """Compare files with what a manifest and the chains note of them."""
        recorded = checked(self.manifest_file, manifest, RecordedHashes)
        noted = dict(recorded.hashes)
        # Draws that can be gathered again may be missing.
        if self.posterior_file.is_file() and recorded.posterior_sha256 is not None:
            noted[self.posterior_file.name] = recorded.posterior_sha256
        wrong = [
            f"{name} {'has changed' if found else 'is missing'}"
            for name, digest in noted.items()
            if (found := _hash_of_file(self.path / name, hash_of)) != digest
        ]
        for chain in self.finished_chains():
            for extension in range(self.n_extensions() + 1):
                wrong += self._faults_of_chain(chain, extension, recorded, hash_of)
        wrong += [f"{name} has become a folder" for name in RESULTS if (self.path / name).is_dir()]
        if wrong:
            raise InputError(
                f"{self.path}: {', '.join(wrong)} since the run, whose hashes say so; {REMEDY}."
            )

    def _faults_of_chain(
        self, chain: int, extension: int, recorded: RecordedHashes, hash_of: Callable[[Path], str]
    ) -> list[str]:
        """Say which differs: the draws of a chain, or what one of two files notes of their hash."""
        files = self.draws_file(chain, extension), self.timing_file(chain, extension)
        draws, timing = (file.relative_to(self.path).as_posix() for file in files)
        own = self.chain_record(chain, extension).sha256
        noted = recorded.draws_hash(chain, extension)
        found = _hash_of_file(files[0], hash_of)
        if found == own:
            is_noted = noted in (None, found)
            return [] if is_noted else [f"the hash of {draws} in manifest.json has changed"]
        if found is None:
            return [f"{draws} is missing"]
        if found == noted:
            return [f"{timing} has changed"]
        return [f"{draws} has changed" if noted else f"{draws} or {timing} has changed"]

    @contextmanager
    def claimed(
        self, fingerprint: str, folders: Sequence[str] = FOLDERS, *, shared: bool = False
    ) -> Iterator[None]:
        """Hold the directory, with `folders` in it, for a run with these inputs, new or continued.

        A second process is kept out; a killed process lets go. `shared` says that others with the
        same inputs may be at work in it: it is waited for, and nothing in it is cleared.
        """
        self._refuse_others(fingerprint)
        with self._locked(PATIENCE if shared else 0.0):
            # Another process may have come first.
            self._refuse_others(fingerprint)
            self._prepare(fingerprint, folders, clear=not shared)
            try:
                yield
            finally:
                if not shared:
                    shutil.rmtree(self._scratch, ignore_errors=True)

    def _refuse_others(self, fingerprint: str) -> None:
        """Raise where the directory holds something else; nothing is written."""
        if len(str(self.path).splitlines()) > 1 or "\0" in str(self.path):
            raise InputError(
                f"{str(self.path)!r}: has a line break or a zero byte in its path, expected none."
            )
        try:
            if self.manifest_file.is_file():
                found = self.read_manifest().get("fingerprint")
                if found != fingerprint:
                    raise InputError(
                        f"{self.path}: holds a run of other inputs (fingerprint "
                        f"{str(found)[:12]}, these inputs have {fingerprint[:12]}); choose "
                        "another --out or remove it."
                    )
            elif self.path.is_dir():
                # A run that was killed before its first file may have left these.
                names = {entry.name for entry in self.path.iterdir()} - {".lock", ".scratch"}
                if strangers := [name for name in names if not is_unfinished(name)]:
                    raise InputError(
                        f"{self.path}: has files ({min(strangers)}) but no manifest.json; "
                        "expected an empty or new folder, or one of an earlier run."
                    )
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror}).") from error

    @contextmanager
    def _locked(self, patience: float) -> Iterator[None]:
        """Keep other processes out."""
        taken = f"{self.path}: another process is running a fit here"
        remedy = "wait for it or choose another --out"
        with ExitStack() as held:
            try:
                self.path.mkdir(parents=True, exist_ok=True)
                lock = process_lock(self.path / ".lock", taken, remedy, patience=patience)
                held.enter_context(lock)
            except OSError as error:
                raise InputError(f"{self.path}: cannot be written ({error.strerror}).") from error
            yield

    def _prepare(self, fingerprint: str, folders: Sequence[str], *, clear: bool) -> None:
        """Make the folders, and remove what killed attempts left behind."""
        try:
            if not self.manifest_file.is_file():
                # Before everything else, so that a run killed early is known as ours.
                self.write_manifest({"fingerprint": fingerprint, "status": "claimed"})
            self.require_unchanged()
            # What is written from here on is noted when it is complete.
            self.update_manifest({"hashes": {}, "chains": self.chain_records()})
            for folder in folders:
                (self.path / folder).mkdir(exist_ok=True)
            if clear:
                # What cannot be removed is in nobody's way: it is never read.
                shutil.rmtree(self._scratch, ignore_errors=True)
                for folder in ("", "failures", *folders):
                    for leftover in (self.path / folder).glob(f"{UNFINISHED}*"):
                        if is_unfinished(leftover.name):
                            leftover.unlink()
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror}).") from error

    def clear(self, fingerprint: str) -> None:
        """Remove the run, and nothing else that may lie here, to make place for another one."""
        with self._locked(0.0):
            try:
                for entry in self.path.iterdir():
                    if entry.name not in WRITTEN and not is_unfinished(entry.name):
                        continue
                    if entry.is_dir() and not entry.is_symlink():
                        shutil.rmtree(entry)
                    else:
                        entry.unlink()
                # Until here the manifest says what is left of the old run.
                self.write_manifest({"fingerprint": fingerprint, "status": "claimed"})
            except OSError as error:
                raise InputError(f"{self.path}: cannot be removed ({error.strerror}).") from error

    def new_scratch(self) -> Path:
        """Return a new folder for files that are not finished."""
        folder = self._scratch / uuid.uuid4().hex
        folder.mkdir(parents=True)
        return folder

    def supersede_chains(self, name: str, chains: Sequence[int]) -> str:
        """Put finished chains aside under a name, remove their results, return where they are."""
        aside = self.path / "superseded" / name
        # A run killed in the midst of this was sampled again: the same chains.
        shutil.rmtree(aside, ignore_errors=True)
        aside.mkdir(parents=True)
        for chain in chains:
            self.chain_folder(chain).rename(aside / self.chain_folder(chain).name)
        self._remove_results()
        return aside.relative_to(self.path).as_posix()

    def keep_chain(
        self, chain: int, finished: Path, *, wall_seconds: float, extension: int = 0
    ) -> None:
        """Note a finished chain in its folder and move that into place, all files at once."""
        digest = sha256_of_file(finished / "draws.csv")
        record = ChainRecord(wall_seconds=wall_seconds, sha256=digest, extension=extension)
        write_json(finished / "timing.json", record.model_dump())
        for file in finished.iterdir():
            flush_to_disk(file)
        before = self.draws_files()
        finished.rename(self.extended_folder(chain, extension))
        flush_to_disk(self.path / "chains")
        if self.draws_files() != before:
            self._remove_results()

    def _remove_results(self) -> None:
        """Remove what was made of draws that are no longer those of the run."""
        for name in RESULTS:
            (self.path / name).unlink(missing_ok=True)


def _hash_of_file(file: Path, hash_of: Callable[[Path], str]) -> str | None:
    """Return the hash of a file, None where there is none."""
    return hash_of(file) if file.is_file() else None
