"""Stop every writing command at every change of the disk: python tests/robustness/kill_points.py

Each command (generate, evaluate, tune, leaderboard, import, export) is run over the output of an earlier run, and
stopped by SIGKILL, SIGTERM and SIGINT just before and just after each of its calls of fsync, rename, unlink and rmdir,
each time in a fresh copy of its folder. Then

- the earlier output or the new output must exist and be intact; otherwise it is *lost*;
- the same command, run again, must succeed and give the output of an uninterrupted run; otherwise it *differs*;
- no other files may be left in any folder, including that of temporary files and the user's folder: *leftovers*;
- no run may print a traceback or an ignored exception, and a stopped run says so in one line.

The jobs of ``generate`` run in the process that is stopped, as on a machine that is switched off; for workers that die
alone see ``kill_workers.py``. Processes are forked from one that has imported everything, so that a point takes a
second.
"""

import argparse
import contextlib
import gc
import hashlib
import importlib
import itertools
import os
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))  # as pytest does

import numpy as np
from inline_jobs import run_jobs_inline
from planted_sweeps import list_streams, write_sweep
from small_dataset import SCENES, SMALL_RECIPE

from saf_gen.benchmark import kept_sequences
from saf_gen.benchmark.method_spec import read_tuned
from saf_gen.benchmark.records import read_records, record_to_json
from saf_gen.cli import main, root_command
from saf_gen.errors import BadInput
from saf_gen.generate import run as generate_run
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

CHANGES = ("fsync", "rename", "replace", "unlink", "remove", "rmdir")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
TIMED = ("seconds", "reference_rate", "over_declared")
LOADED = {
    "generate": ("mitsuba", "saf_gen.authoring.contact_sheet", "saf_gen.generate.resolve", "saf_gen.render.grain"),
    "tune": ("saf_gen.leaderboard.tuning", "saf_gen.plugins.searches", "scipy.signal"),
    "import": ("saf_gen.stream.interop",),
    "export": ("saf_gen.stream.interop",),
    "leaderboard": ("scipy.signal",),
    "evaluate": ("scipy.signal",),
}
"""Modules that a command imports while it runs, by command; they are imported before processes are forked."""
LIMIT_S = 300


@dataclass(frozen=True)
class Writer:
    """A command that is run in a separate folder, its output, and how the output is read.

    ``state`` returns the content of the output, or None if there is no output; it raises BadInput if the output is
    damaged.
    """

    name: str
    arguments: tuple[str, ...]
    out: str
    state: Callable[[Path], Any]


def state_of_stream(path: Path) -> Any:
    if not path.exists():
        return None
    with open_stream(path) as stream:
        stream.verify()
        return stream.content_sha256


def state_of_records(folder: Path) -> Any:
    """Return the records without the seconds that they took."""
    return [{k: v for k, v in record_to_json(r).items() if k not in TIMED} for r in read_records(folder)]


def state_of_dataset(folder: Path) -> Any:
    """Return the digests in the manifest, or None if it lists no sequence, after checking all existing streams."""
    for path in folder.glob("*/*.h5"):
        state_of_stream(path)
    if not (folder / "manifest.json").exists():
        return None
    return {entry.id: entry.content_sha256 for entry in read_manifest(folder).sequences} or None


def state_of_bytes(path: Path) -> Any:
    if path.is_dir():
        return {file.name: state_of_bytes(file) for file in path.iterdir()}
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else None


def state_of_tuned(path: Path) -> Any:
    return read_tuned(path)


TRY = ("--method", "sd+argmax", "--try", "search.window=100,200")
WRITERS = (
    Writer("export", ("export", "wide.h5", "--out", "out.dat", "--layout", "dense"), "out.dat", state_of_bytes),
    Writer("import", ("import", "frames.npy", "--axes", "TYX", "--out", "out.h5"), "out.h5", state_of_stream),
    Writer("tune", ("tune", "data", *TRY, "--out", "out.json"), "out.json", state_of_tuned),
    Writer("generate", ("generate", "small.yaml", "--out", "out", "--variant", "scalar"), "out", state_of_dataset),
    Writer("leaderboard", ("leaderboard", "merge", "one", "two", "--out", "out"), "out", state_of_records),
    Writer("evaluate", ("evaluate", "data", "--method", "sd+argmax", "--out", "out"), "out", state_of_records),
)


class Machine:
    """Runs commands in forked processes, in a folder that represents the entire disk of a machine."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, writer: Writer, *, stop: tuple[int, bool, int] | None = None) -> tuple[int, str, list[str]]:
        """Run a command, and return its exit code, the text that it printed on stderr, and its changes of the disk.

        With ``stop`` = (number, after, signal), the signal is sent before or after the change with this number.
        """
        messages, changes = self.folder.with_suffix(".stderr"), self.folder.with_suffix(".changes")
        child = os.fork()
        if child == 0:
            with contextlib.suppress(BaseException):
                self._become(writer, stop, messages=messages, changes=changes)
            os._exit(99)
        end = time.monotonic() + LIMIT_S
        while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0):
            if time.monotonic() > end:
                os.kill(child, signal.SIGKILL)
            time.sleep(0.005)
        return os.waitstatus_to_exitcode(ended[1]), messages.read_text(), changes.read_text().splitlines()

    def _become(self, writer: Writer, stop: tuple[int, bool, int] | None, *, messages: Path, changes: Path) -> None:
        os.chdir(self.folder / "work")
        signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs of a shell ignore Ctrl-C
        os.environ.update(
            XDG_CONFIG_HOME=str(self.folder / "config"), TMPDIR=str(self.folder / "tmp"), SAF_GEN_SCENES=str(SCENES)
        )
        tempfile.tempdir = None
        with messages.open("wb") as stderr, Path(os.devnull).open("wb") as stdout:
            os.dup2(stderr.fileno(), 2)
            os.dup2(stdout.fileno(), 1)
        log = os.open(changes, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
        numbers = itertools.count()

        def watched(name: str, change: Callable[..., Any]) -> Callable[..., Any]:
            def do(*given: Any, **how: Any) -> Any:
                place = find_place(given[0], how)
                if not place.is_relative_to(self.folder):  # such as compiled code
                    return change(*given, **how)
                number = next(numbers)
                os.write(log, f"{name} {place.relative_to(self.folder)}\n".encode())
                if stop is not None and stop[:2] == (number, False):
                    os.kill(os.getpid(), stop[2])
                try:
                    return change(*given, **how)
                finally:  # also if there was nothing to remove
                    if stop is not None and stop[:2] == (number, True):
                        os.kill(os.getpid(), stop[2])

            return do

        for name in CHANGES:
            setattr(os, name, watched(name, getattr(os, name)))
        try:
            main(list(writer.arguments))
        except SystemExit as ended:
            sys.stderr.flush()
            os._exit(ended.code if isinstance(ended.code, int) else 98)
        except BaseException:  # noqa: BLE001  (the tool looks for tracebacks)
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(97)


def find_place(given: Any, how: dict[str, Any]) -> Path:
    """Return the path that is changed, which may be given as an open file, or relative to an open folder."""
    if isinstance(given, int):
        return Path(f"/proc/self/fd/{given}").readlink()
    inside = how.get("dir_fd")
    return (Path.cwd() if inside is None else Path(f"/proc/self/fd/{inside}").readlink()) / given


def names_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def prepare(folder: Path) -> None:
    """Create the folders of a machine, with the data that the commands read."""
    work = folder / "work"
    for name in ("work", "config", "tmp"):
        (folder / name).mkdir(parents=True)
    for name, peak in (("one", 300.0), ("two", 500.0)):
        write_sweep(work / "data" / "train" / f"{name}.h5", peak)
    list_streams(work / "data", *({"id": name, "split": "train", "scene": name} for name in ("one", "two")))
    random = np.random.default_rng(1)
    np.save(work / "frames.npy", random.random((400, 16, 24)) < 0.2)
    write_stream(work / "wide.h5", random.random((40, 250, 400)) < 0.2)
    (work / "small.yaml").write_text(SMALL_RECIPE.replace("constant, continuous, lamp_only", "constant"))


def make_earlier(machine: Machine, writer: Writer) -> None:
    """Create an earlier output at the path to which a command writes."""
    work = machine.folder / "work"
    methods = {"one": "er_count+argmax", "two": "sd+argmax"}
    needed = {"leaderboard": {**methods, "out": "sd+egs_code"}, "evaluate": {"out": "sd+egs_code"}}
    for out, method in needed.get(writer.name, {}).items():
        expect_well(
            machine, Writer("before", ("evaluate", "data", "--method", method, "--out", out), out, state_of_bytes)
        )
    if writer.name == "tune":
        shutil.copytree(work / "data", work / "kept")
        expect_well(
            machine, Writer("before", ("tune", "data", *TRY[:3], "search.window=50,80", "--out", "out.json"), "", str)
        )
        shutil.rmtree(work / "kept")
    if writer.name == "import":  # export replaces nothing
        write_stream(work / "out.h5", np.load(work / "frames.npy")[:100])
    shutil.rmtree(machine.folder / "config")  # the user's secret is made again
    (machine.folder / "config").mkdir()


def expect_well(machine: Machine, writer: Writer) -> list[str]:
    code, messages, changes = machine.run(writer)
    if code:
        raise SystemExit(f"{' '.join(writer.arguments)} ended with {code}: {messages}")
    return changes


def check_point(
    machine: Machine, writer: Writer, stop: tuple[int, bool, int], *, before: Any, whole: Any, names: set[str]
) -> Iterator[tuple[str, str]]:
    """Stop a command at a point and run it again; yield the kind and the description of each fault."""
    out = machine.folder / "work" / writer.out
    code, messages, _ = machine.run(writer, stop=stop)
    expected = {signal.SIGKILL: -signal.SIGKILL, signal.SIGTERM: 143, signal.SIGINT: 130}[stop[2]]
    if code != expected:
        yield "not stopped", f"exit code {code}, not {expected}: {messages[-300:]}"
    yield from check_words(messages, stopped=stop[2] != signal.SIGKILL)
    try:
        if (state := writer.state(out)) not in (before, whole):
            yield "lost", f"neither the earlier output nor the new one: {str(state)[:200]}"
    except BadInput as error:
        yield "lost", str(error)
    code, messages, _ = machine.run(writer)
    if code:
        yield "not done again", f"exit code {code}: {messages[-300:]}"
    yield from check_words(messages, stopped=False)
    try:
        if writer.state(out) != whole:
            yield "differs", "the output of the next run is another"
    except BadInput as error:
        yield "differs", str(error)
    if left := names_in(machine.folder) - names:
        yield "leftovers", ", ".join(sorted(left))
    if missing := names - names_in(machine.folder):
        yield "lacks", ", ".join(sorted(missing))


def check_words(messages: str, *, stopped: bool) -> Iterator[tuple[str, str]]:
    lines = [line for line in messages.splitlines() if line.startswith("saf-gen:")]
    if "Traceback" in messages or "Exception ignored" in messages or "Error" in messages:
        yield "traceback", messages[-1500:]
    if len(lines) != stopped:
        yield "words", f"{len(lines)} lines of saf-gen: {messages[-300:]}"


def kill_all(writer: Writer, folder: Path, *, every: int, first: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Stop a command at every ``every``-th of its points, and return counts and findings."""
    begun, start, machine = time.monotonic(), folder / f"{writer.name}-start", Machine(folder / writer.name)
    prepare(start)
    make_earlier(Machine(start), writer)
    out = Path("work") / writer.out
    try:
        before = writer.state(start / out)
    except BadInput:
        before = None
    shutil.copytree(start, machine.folder, symlinks=True)
    changes = expect_well(machine, writer)
    whole, names = writer.state(machine.folder / out), names_in(machine.folder)
    points = list(itertools.product(range(len(changes)), (False, True), SIGNALS))[first::every]
    findings = []
    for point in points:
        shutil.rmtree(machine.folder)
        shutil.copytree(start, machine.folder, symlinks=True)
        when, name = "after" if point[1] else "before", signal.Signals(point[2]).name
        for what, why in check_point(machine, writer, point, before=before, whole=whole, names=names):
            findings.append([what, f"{writer.name}, {when} {changes[point[0]]}, {name}", why])
            tell(": ".join(findings[-1]))
    shutil.rmtree(machine.folder)
    shutil.rmtree(start)
    seconds = time.monotonic() - begun
    tell(f"{writer.name}: {len(changes)} changes, {len(points)} points, {len(findings)} wrong, {seconds:.0f} s")
    return {"writer": writer.name, "points": len(points), "findings": findings}


def stop_writers(
    names: Sequence[str] = (), *, every: int = 1, first: int = 0, tell: Callable[[str], None] = print
) -> list[dict[str, Any]]:
    """Stop commands, all by default, at every N-th of their points; return the counts and findings of each.

    The calling process is forked, so it must not have run compiled code on several threads.
    """
    kept_sequences.WRITE_INTERVAL_S = 0.0
    generate_run.run_jobs = run_jobs_inline
    chosen = [writer for writer in WRITERS if not names or writer.name in names]
    for name in itertools.chain.from_iterable(LOADED.get(writer.name, ()) for writer in chosen):
        importlib.import_module(name)
    root_command()  # otherwise each forked process would build it again
    gc.freeze()
    with tempfile.TemporaryDirectory(prefix="kill-points-") as folder:
        return [kill_all(writer, Path(folder), every=every, first=first, tell=tell) for writer in chosen]


def main_of_tool() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--only", nargs="+", choices=[writer.name for writer in WRITERS], help="only these commands")
    options.add_argument("--every", type=int, default=1, help="test only every N-th point")
    options.add_argument("--first", type=int, default=0, help="number of the first point to test")
    given = options.parse_args()
    found = stop_writers(given.only or (), every=given.every, first=given.first)
    wrong = sum(len(one["findings"]) for one in found)
    print(f"{sum(one['points'] for one in found)} points, {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main_of_tool())
