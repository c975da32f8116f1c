"""Packed files of strangers, for the commands that read them: cheap, one line, and nothing outside.

``python tests/robustness/hostile_archives.py --count 200 --seed 1`` draws files of :mod:`hostile_files` in turn, and
runs a command on each in a forked process. It ends with 1 if a command prints a traceback, is silent for 20 seconds,
takes more memory than MAX_BYTES or than 100 times the file above WORK_BYTES, writes outside its target, accepts what
must be refused, or ends with 0 and other spikes than the file holds.
"""

import argparse
import contextlib
import os
import resource
import select
import shutil
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))  # as pytest does

import numpy as np
from hostile_files import Hostile, digest, draw
from planted_sweeps import write_three_sweeps

import saf_gen
from saf_gen.cli import main, root_command
from saf_gen.stream.time_blocks import BUDGET_BYTES

SILENCE_S, LIMIT_S = 20.0, 240.0
MAX_BYTES, WORK_BYTES, RATIO = 2 << 30, 512 << 20, 100
"""Most memory of a command; what it may use for its work whatever the size of its file; and how often a file's size."""
ADDRESS_BYTES = 12 << 30
"""Limit of the address space, which protects the machine alone: libraries reserve more than they use."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code (-N for a signal), what it printed, its longest silence and its memory."""

    code: int
    said: str
    silence_s: float
    seconds: float
    bytes: int


def prepare(folder: Path) -> None:
    """Write what the commands need besides the hostile file."""
    rng = np.random.default_rng(3)
    np.save(folder / "camera.npy", rng.integers(0, 2, (200, 64, 64), dtype=np.uint8))
    saf_gen.write_stream(folder / "camera.h5", rng.integers(0, 2, (64, 16, 16), dtype=np.uint8))
    write_three_sweeps(folder / "whole")


def run_command(command: str, folder: Path) -> Ended:
    """Run a command in a forked process of its own, in a folder."""
    reader, writer = os.pipe()
    begun = time.monotonic()
    child = os.fork()
    if not child:
        os.close(reader)
        code = 70
        try:
            os.chdir(folder)
            for number in (1, 2):
                os.dup2(writer, number)
            sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
            resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_BYTES, ADDRESS_BYTES))
            main(command.split())
        except SystemExit as ended:
            code = int(ended.code or 0)
        except BaseException:  # noqa: BLE001 - a user would see any of them as a traceback
            traceback.print_exc()
        sys.stdout.flush()
        os._exit(code)
    os.close(writer)
    said, silence, heard, peak, busy = b"", 0.0, begun, 0, 0.0
    at_start = _resident(child)
    while True:
        ready, _, _ = select.select([reader], [], [], 0.05)
        peak = max(peak, _resident(child))
        now, spent = time.monotonic(), _busy(child)
        if ready:
            block = os.read(reader, 1 << 16)
            silence, heard = max(silence, spent - busy), now
            busy = spent
            if not block:
                break
            said += block
        elif now - begun > LIMIT_S or now - heard > 4 * SILENCE_S or peak - at_start > 2 * MAX_BYTES:
            os.kill(child, signal.SIGKILL)
            silence = max(silence, now - heard)
            break
    _, status = os.waitpid(child, 0)
    os.close(reader)
    code, seconds = os.waitstatus_to_exitcode(status), time.monotonic() - begun
    return Ended(code, said.decode(errors="replace"), silence, seconds, max(peak - at_start, 0))


def _busy(process: int) -> float:
    """Return the computing time of a process in s, which a machine that others use does not lengthen."""
    with contextlib.suppress(OSError, IndexError):
        words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return sum(map(int, words[11:15])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def _resident(process: int) -> int:
    """Return the memory of a process and of those that it started, without the pages of files."""
    total = 0
    with contextlib.suppress(OSError, ValueError, IndexError):
        held = Path(f"/proc/{process}/status").read_text()
        total = sum(
            int(line.split()[1]) << 10 for line in held.splitlines() if line.startswith(("RssAnon", "RssShmem"))
        )
        for child in Path(f"/proc/{process}/task/{process}/children").read_text().split():
            total += _resident(int(child))
    return total


def judge(hostile: Hostile, ended: Ended, *, size: int, before: dict[str, str], folder: Path) -> list[str]:
    """Return what is wrong with how a command ended; ``before`` are the digests of the files of its folder."""
    faults, lines = [], [line for line in ended.said.splitlines() if line.startswith("saf-gen:")]
    kept = BUDGET_BYTES if hostile.kind.startswith("stream") else 0  # an open stream keeps what was read, to this size
    allowed = min(MAX_BYTES, max(WORK_BYTES + kept, RATIO * size))
    if "Traceback" in ended.said or ended.code not in (0, 1, 2):
        faults.append(f"exit code {ended.code}: {ended.said[-300:]}")
    if "memory ran out" in ended.said or ended.bytes > allowed:
        faults.append(f"{ended.bytes >> 20} MiB, allowed are {allowed >> 20}")
    if ended.silence_s > SILENCE_S:
        faults.append(f"silent for {ended.silence_s:.0f} s")
    if ended.code == 2 and len(lines) != 1:
        faults.append(f"{len(lines)} lines")
    if (hostile.must == "refused" and ended.code == 0) or (hostile.must == "read" and ended.code != 0):
        faults.append(f"exit code {ended.code} where it must be {hostile.must}: {ended.said[-200:]}")
    after = list_files(folder)
    changed = [name for name, found in after.items() if before.get(name) != found]
    allowed_names = ("out", "made", "scenes/made") if ended.code in (0, 1) else ()
    if "index" in hostile.command and ended.code == 0:
        allowed_names = ("manifest.json",)
    if wrong := [name for name in changed if not name.startswith(allowed_names) or ".part" in name]:
        faults.append(f"wrote {wrong[:4]}")
    if ended.code == 0 and hostile.spikes is not None and (folder / "out.h5").exists():
        with saf_gen.open_stream(folder / "out.h5") as stream:
            found = sum(int(stream.counts(at, min(at + 1000, stream.shape[0])).sum())
                        for at in range(0, stream.shape[0], 1000))  # fmt: skip
        if found != hostile.spikes:
            faults.append(f"{found} spikes, not {hostile.spikes}")
    return faults


def list_files(folder: Path) -> dict[str, str]:
    """Return the digest of each file in a folder and below it; of a large one, its size."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {
        str(p.relative_to(folder)): digest(p) if p.stat().st_size < 1 << 24 else str(p.stat().st_size) for p in files
    }


def attempt(seed: int, number: int, base: Path) -> tuple[Hostile, Ended, list[str]]:
    """Draw a file, run its command, and return both with what is wrong."""
    folder = base / f"{seed}-{number}" / "desk"
    shutil.copytree(base / "desk", folder)
    try:
        given = list_files(folder)
        hostile = draw(seed, number, folder)
        before = list_files(folder)
        size = sum((folder / name).stat().st_size for name in before if name not in given)
        ended = run_command(hostile.command, folder)
        faults = judge(hostile, ended, size=size, before=before, folder=folder)
        outside = [path for path in folder.parent.iterdir() if path != folder]
        return hostile, ended, faults + [f"wrote outside: {outside}"] * bool(outside)
    finally:
        shutil.rmtree(folder.parent)


def run(numbers: range, seed: int, say: Callable[[str], None] = print, *, show: bool = False) -> Counter[str]:
    """Try the files with these numbers; return how many were refused, read, and wrong."""
    totals = Counter[str]()
    root_command()  # otherwise each forked process would build it again
    with TemporaryDirectory(prefix="hostile-") as temporary:
        base = Path(temporary)
        os.environ["XDG_CONFIG_HOME"] = str(base / "config")
        (base / "desk").mkdir()
        prepare(base / "desk")
        for number in numbers:
            hostile, ended, faults = attempt(seed, number, base)
            totals["WRONG" if faults else "read" if ended.code == 0 else "refused"] += 1
            if faults or show:
                say(
                    f"{number} {hostile.kind}: {hostile.command}: {'; '.join(faults) or 'well'} ({ended.code}, "
                    f"{ended.seconds:.1f} s, {ended.bytes >> 20} MiB: {ended.said.strip()[-160:]!r})"
                )
    return totals


def main_of_tool() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first file")
    parser.add_argument("--show", action="store_true", help="print how each command ended")
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.count)
    totals = run(numbers, given.seed, lambda line: print(line, flush=True), show=given.show)
    print(", ".join(f"{count} {name}" for name, count in sorted(totals.items())))
    return bool(totals["WRONG"])


if __name__ == "__main__":
    sys.exit(main_of_tool())
