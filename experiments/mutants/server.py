"""Runs tests on a copy of the project, each time in a fork of one process that has the libraries in memory."""

from __future__ import annotations

import contextlib
import functools
import importlib
import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

import pytest

# What hopdiff and its tests import from elsewhere. None of it may start threads or import hopdiff.
LIBRARIES = (
    *("torch", "numpy", "scipy.integrate", "scipy.interpolate", "scipy.ndimage", "scipy.optimize", "scipy.sparse"),
    *("scipy.sparse.csgraph", "scipy.spatial", "scipy.linalg", "scipy.stats", "hydra", "omegaconf", "hypothesis"),
    *("hydra.experimental.callback", "matplotlib.pyplot", "mpl_toolkits.mplot3d", "PIL.Image", "cmaes", "tqdm", "yaml"),
    *("shapely", "svgelements", "trimesh", "tensorboard", "tensorboard.summary", "jaxtyping", "beartype"),
)
COPIED = ("hopdiff", "conf", "tests", "experiments", "pyproject.toml", "README.md")
PATIENCE = 10.0  # s of computing that any test may take, on top of five times as long as it took unchanged
MEMORY = 16 * 2**30  # bytes of address space
KILLED, SURVIVED, TIMEOUT = "killed", "survived", "timeout"
LATE = 9  # exit status of a process whose test took too long


class Test(NamedTuple):
    """seconds: of computing, unchanged. shared: more of them that the tests of its file need together, once.
    functions: those of hopdiff that it calls, as file:line of their beginning."""

    seconds: float
    shared: float
    functions: frozenset[str]


class Outcome(NamedTuple):
    """result: killed, survived or timeout. by: the test that failed, or what else went wrong."""

    result: str
    by: str
    seconds: float


class Copy:
    """A copy of the project below a folder. The process that makes it must not have imported hopdiff."""

    def __init__(self, root: Path, folder: Path, libraries: Sequence[str] = LIBRARIES) -> None:
        self.root, self.folder = root, folder
        skip = shutil.ignore_patterns("pictures", "*.png", "*.gif", ".hypothesis", "outputs")
        for name in COPIED:
            if (root / name).is_dir():
                shutil.copytree(root / name, folder / name, ignore=skip)
            elif (root / name).exists():
                shutil.copy(root / name, folder / name)
        for library in libraries:
            with contextlib.suppress(ImportError):
                importlib.import_module(library)
        if any(name.split(".")[0] == "hopdiff" for name in sys.modules):
            raise RuntimeError("hopdiff is in memory already: its copy could not take its place.")

    @contextlib.contextmanager
    def changed(self, file: str, text: str) -> Iterator[None]:
        """One file of the copy holds another text for a while."""
        path = self.folder / file
        whole, state = path.read_bytes(), path.stat()
        try:
            path.write_text(text, encoding="utf-8")
            # Another time than any bytecode that is kept, whose grain is a second.
            os.utime(path, (1, 1))
            yield
        finally:
            path.write_bytes(whole)
            os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))

    def measured(self, file: str) -> dict[str, Test]:
        """Every test of a file, run unchanged. Raises RuntimeError if one fails."""
        watch = _Watch()
        outcome = self._forked([file], watch, 3600.0)
        if outcome.result != SURVIVED:
            log = (self.folder / "log.txt").read_text(encoding="utf-8", errors="replace")
            raise RuntimeError(f"{file} must pass before anything is changed, but: {outcome.by}\n{log[-3000:]}")
        told = self._told()
        return {name: Test(took, told["shared"], frozenset(calls)) for name, (took, calls) in told["tests"].items()}

    def tried(self, tests: dict[str, Test]) -> Outcome:
        """Runs tests, in this order, up to the first that fails."""
        if not tests:
            return Outcome(SURVIVED, "no test calls it", 0.0)
        watch = _Watch({name: PATIENCE + 5.0 * (t.seconds + t.shared) for name, t in tests.items()})
        files = dict.fromkeys(name.split("::")[0] for name in tests)
        return self._forked(list(files), watch, 600.0 + 60.0 * sum(t.seconds + t.shared for t in tests.values()))

    def _told(self) -> dict[str, Any]:
        path = self.folder / "told.json"
        return json.loads(path.read_text()) if path.exists() else {}

    def _forked(self, files: Sequence[str], watch: _Watch, limit: float) -> Outcome:
        (self.folder / "told.json").unlink(missing_ok=True)
        begun = time.monotonic()
        child = os.fork()
        if not child:
            self._run(files, watch)
        while (status := os.waitpid(child, os.WNOHANG))[0] == 0:
            if time.monotonic() - begun > limit:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return Outcome(TIMEOUT, "all tests together", time.monotonic() - begun)
            time.sleep(0.02)
        took = time.monotonic() - begun
        code = os.waitstatus_to_exitcode(status[1])
        by = self._told().get("failed", "")
        if code == LATE:
            return Outcome(TIMEOUT, by, took)
        if code == pytest.ExitCode.NO_TESTS_COLLECTED:
            raise RuntimeError(f"no test of {', '.join(files)} was found again")
        return Outcome(SURVIVED if code == 0 else KILLED, by or ("" if code == 0 else f"exit status {code}"), took)

    def _run(self, files: Sequence[str], watch: _Watch) -> None:
        """In the child: run pytest and end."""
        code = 70
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            log = os.open(self.folder / "log.txt", os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            for stream in (1, 2):
                os.dup2(log, stream)
            os.chdir(self.folder)
            os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
            sys.path[:] = [str(self.folder), *(p for p in sys.path if p and Path(p).resolve() != self.root)]
            for name in [name for name in sys.modules if name.split(".")[0] in ("experiments", "tests")]:
                del sys.modules[name]
            sys.dont_write_bytecode = watch.limits is not None
            watch.told = self.folder / "told.json"
            # The libraries were read before pytest could rewrite what asserts they hold.
            quiet = ("-W", "ignore::pytest.PytestAssertRewriteWarning")
            # Tests of speed fail on a busy machine, whatever the code.
            options = [
                *quiet,
                "-p",
                "pytest_benchmark.plugin",
                "--benchmark-skip",
                "-x",
                "-q",
                "-p",
                "no:cacheprovider",
                "--rootdir",
                str(self.folder),
            ]
            code = int(pytest.main([*options, *files], plugins=[watch]))
            strange = {str(p) for p in watch.homes() if not Path(p).is_relative_to(self.folder)}
            watch.tell()
            if strange:
                code = 71
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            os._exit(code)


class _Watch:
    """What pytest is told and tells: which tests in which order, how long they may take, what they call.

    limits: seconds of each test, in order; None runs all tests and notes what they call.
    """

    def __init__(self, limits: dict[str, float] | None = None) -> None:
        self.limits = limits
        self.told = Path()
        self.failed = ""
        self.tests: dict[str, tuple[float, set[str]]] = {}
        self.calls: set[CodeType] = set()  # of the test that runs
        self.shared: set[CodeType] = set()  # of what is made once and kept for the tests after it
        self.kept: set[CodeType] = set()  # functions whose results are kept
        self.depth = 1  # while a test file is read, everything is for all
        self.clock = 0.0  # when the outermost of it began
        self.seconds = 0.0  # that all of it took
        if limits is None:
            sys.settrace(self._called)

    def homes(self) -> set[str]:
        return {m.__file__ for name, m in sys.modules.items() if name.split(".")[0] == "hopdiff" and m.__file__}

    def tell(self) -> None:
        named = {name: (took, sorted(calls)) for name, (took, calls) in self.tests.items()}
        self.told.write_text(json.dumps({"failed": self.failed, "shared": self.seconds, "tests": named}))

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self.limits is not None:
            place = {name: k for k, name in enumerate(self.limits)}
            items[:] = sorted((i for i in items if i.nodeid in place), key=lambda i: place[i.nodeid])
            return
        self.depth = 0
        for name, module in list(sys.modules.items()):
            if name.split(".")[0] in ("hopdiff", "tests"):
                for value in vars(module).values():
                    if isinstance(value, functools._lru_cache_wrapper):
                        self.kept.add(value.__wrapped__.__code__)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Any:
        if fixturedef.scope == "function":
            return (yield)
        self._in()
        try:
            return (yield)
        finally:
            self._out()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        begun = time.process_time()
        if self.limits is not None:
            # Computing, not waiting: others may use the machine too.
            signal.signal(signal.SIGPROF, functools.partial(self._late, item.nodeid))
            signal.setitimer(signal.ITIMER_PROF, self.limits[item.nodeid])
        self.calls, before = set(), self.seconds
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            calls = {_place(code) for code in self.calls | self.shared}
            own = time.process_time() - begun - (self.seconds - before)
            self.tests[item.nodeid] = (own, calls)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed = self.failed or report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.failed = self.failed or f"{report.nodeid} (cannot be read)"

    def _in(self) -> None:
        if not self.depth:
            self.clock = time.process_time()
        self.depth += 1

    def _out(self) -> None:
        self.depth -= 1
        if not self.depth:
            self.seconds += time.process_time() - self.clock

    def _late(self, name: str, *_: object) -> None:
        self.failed = name
        self.tell()
        os._exit(LATE)

    def _called(self, frame: FrameType, event: str, argument: object) -> Any:
        """A trace function that sees calls only, and the returns of what is kept."""
        code = frame.f_code
        if self.depth:
            self.shared.add(code)
        else:
            self.calls.add(code)
        if code in self.kept:
            self.shared.add(code)
            self._in()
            return self._left
        return None

    def _left(self, frame: FrameType, event: str, argument: object) -> Any:
        if event == "return":
            self._out()
        frame.f_trace_lines = False
        return self._left


def _place(code: CodeType) -> str:
    """File below the project and line of a code object, such as hopdiff/costs.py:82; empty for foreign code."""
    _, inside, path = code.co_filename.rpartition("/hopdiff/")
    # The checkout itself may be called hopdiff.
    ours = inside and not path.startswith(("experiments/", "tests/"))
    return f"hopdiff/{path}:{code.co_firstlineno}" if ours else ""
