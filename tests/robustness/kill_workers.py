"""Kill workers of a run at random, and then the scheduler: python tests/robustness/kill_workers.py --kills 20 --seed 1

A small dataset is generated four times: without a kill, as the reference; while workers of the process pool are killed;
while workers of a Dask cluster on this machine are killed; and while its scheduler is killed. All sequences in the
manifest must then have the right digest, and a line must report each missing sequence, or the loss of the scheduler.
The same command, run again, must make the missing sequences and leave no other files. No run may print a traceback.
"""

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests/helpers"))  # as pytest does

from dask_processes import children, scheduler_process, wait_until, worker_processes  # noqa: E402
from small_dataset import SCENES, SMALL_RECIPE  # noqa: E402

from saf_gen.stream.dataset import verify_dataset  # noqa: E402
from saf_gen.stream.manifest import read_manifest  # noqa: E402

LINES = (
    r"again: record |done: |waiting: |saf-gen: record \S+ failed: |saf-gen: the Dask scheduler at |\d+ sequences"
    "|dataset: "
)
"""Allowed beginnings of the lines that a run prints."""


@dataclass(frozen=True)
class Trials:
    """The folder in which a recipe is generated under several names, and how often workers are killed."""

    folder: Path
    kills: int
    random: random.Random

    def start(self, name: str, *options: str) -> subprocess.Popen[bytes]:
        """Start ``saf-gen generate`` with the stacks of the run without a kill, and return the process."""
        made, whole = self.folder / name, self.folder / "whole"
        if whole.is_dir() and not made.exists():
            shutil.copytree(whole / "stacks", made / "stacks")
        command = [sys.executable, "-m", "saf_gen", "generate", "recipe.yaml", "--out", name, "--workers=2", *options]
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        environment = os.environ | {"PYTHONPATH": path, "SAF_GEN_SCENES": str(SCENES)}
        with (self.folder / f"{name}.log").open("wb") as log:
            return subprocess.Popen(command, cwd=self.folder, stdout=log, stderr=log, env=environment)

    def read_digests(self, name: str) -> dict[str, str]:
        """Return the digests of the sequences in the manifest, after a check that all their streams are intact."""
        _, problems = verify_dataset(self.folder / name)
        assert not problems, problems
        return {entry.id: entry.content_sha256 for entry in read_manifest(self.folder / name).sequences}

    def kill_workers(self, run: subprocess.Popen[bytes], workers: Callable[[], list[int]]) -> int:
        """Kill processes one after the other while the run lasts, and return how many were killed."""
        killed = 0
        while killed < self.kills and run.poll() is None:
            time.sleep(self.random.uniform(0.5, 2.5))
            if (there := workers()) and run.poll() is None:
                with suppress(ProcessLookupError):
                    os.kill(self.random.choice(there), signal.SIGKILL)
                    killed += 1
        return killed

    def judge(self, name: str, *options: str, code: int, lost: bool = False) -> str:
        """Check the results of a run that ended with ``code``, run it again, check again, and return a summary.

        With ``lost`` the scheduler was killed, and a single line reports everything that is missing.
        """
        lines = (self.folder / f"{name}.log").read_text().splitlines()
        whole, found = self.read_digests("whole"), self.read_digests(name)
        strange = [line for line in lines if not re.match(LINES, line)]
        assert not strange, strange
        failed = {line.split()[2] for line in lines if " failed: " in line}
        assert all(whole[one] == digest for one, digest in found.items()), "another digest"
        missing = set(whole) - set(found)
        assert code == (1 if missing else 0)
        assert lost or missing == failed, (missing, failed)
        assert not lost or (missing and "Dask scheduler" in lines[-1]), lines[-1]
        again = sum(line.startswith("again: ") for line in lines)
        second = self.start(name, *options)
        assert second.wait() == 0
        assert self.read_digests(name) == whole
        left = [path for path in (self.folder / name).rglob(".*") if path.is_file()]
        assert not left, left
        return (
            f"{len(found)} of {len(whole)} whole, all with the right digest; {len(failed)} set aside and named; "
            f"{again} lines of jobs run again; {len(whole)} of {len(whole)} after the same command again, 0 leftovers"
        )


def is_worker(pid: int) -> bool:
    """Return whether a child of a run is a worker, and not a helper of Python that is just being started."""
    with suppress(FileNotFoundError):
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def try_pool(trials: Trials) -> str:
    run = trials.start("pool")
    killed = trials.kill_workers(run, lambda: [pid for pid in children(run.pid) if is_worker(pid)])
    return f"pool: {killed} workers killed; {trials.judge('pool', code=run.wait())}"


def try_dask(trials: Trials) -> str:
    with ExitStack() as undo:
        _, address = undo.enter_context(scheduler_process(trials.folder))
        nannies = [undo.enter_context(worker_processes(trials.folder, address, "--nworkers", "1")) for _ in range(2)]

        def workers() -> list[int]:
            """Return the worker processes, after replacing nannies that ended.

            A worker that is killed while it starts ends its nanny as well, which a batch system would start again.
            """
            for at, nanny in enumerate(nannies):
                if nanny.poll() is not None:
                    nannies[at] = undo.enter_context(worker_processes(trials.folder, address, "--nworkers", "1"))
            return [pid for nanny in nannies for pid in children(nanny.pid)]

        run = trials.start("dask", "--cluster", address)
        killed = trials.kill_workers(run, workers)
        while run.poll() is None:
            workers()
            time.sleep(0.5)
        code = run.wait()
        return f"Dask: {killed} workers killed; {trials.judge('dask', '--cluster', address, code=code)}"


def try_scheduler(trials: Trials) -> str:
    with ExitStack() as undo:
        scheduler, address = undo.enter_context(scheduler_process(trials.folder))
        undo.enter_context(worker_processes(trials.folder, address))
        run = trials.start("lost", "--cluster", address)
        wait_until(lambda: len(list(trials.folder.glob("lost/test/*.h5"))) >= 2)
        os.killpg(scheduler.pid, signal.SIGKILL)
        return f"Dask: the scheduler killed; {trials.judge('lost', code=run.wait(), lost=True)}"


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=30, help="number of recordings under each of three lights")
    parser.add_argument("--frames", type=int, default=40_000)
    parser.add_argument("--only", choices=["pool", "dask", "scheduler"], help="run only one of the three trials")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(Path(folder), given.kills, random.Random(given.seed))
        recipe = SMALL_RECIPE.replace("frames: 400", f"frames: {given.frames}")
        recipe = recipe.replace("lamp_only]}", f"lamp_only], repeats: {given.repeats}}}")
        (trials.folder / "recipe.yaml").write_text(recipe)
        assert trials.start("whole").wait() == 0
        print(f"seed {given.seed}: {len(trials.read_digests('whole'))} sequences of {given.frames} frames", flush=True)
        for name, trial in (("pool", try_pool), ("dask", try_dask), ("scheduler", try_scheduler)):
            if given.only in (None, name):
                print(trial(trials), flush=True)


if __name__ == "__main__":
    main()
