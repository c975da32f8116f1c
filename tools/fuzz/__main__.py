"""Feed saf-gen corrupted input of every kind, and report behaviour that a user should never see.

    python tools/fuzz --inputs 10000 --seed 17

There are seventeen kinds of input: recipe, scene card, geometry of a scene (XML, meshes, texture), sensor file,
actuator file, stream, manifest, records, tuned file, predictions, list of methods, logs of lens and light, camera files
(raw, arrays, MATLAB, SAF's folder), packed datasets (index, shards), pictures, focal stacks, meshes of new scenes. Each
input is a valid sample (samples.py) with something changed (changes.py): hostile values, broken text, bytes, links,
archives with correct checksums, pipes and devices instead of files.

A fault is a traceback, an error of more than one line, an exit code other than 0, 1 and 2, 20 s of processor time or
5 minutes without an end, 2 GiB of memory, a process that dies, a control character on the terminal, the content of
another file, planted code that was run, or a file written in spite of an error. (seed, kind, number) identifies a case,
and --only repeats it.
"""

import argparse
import collections
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from kinds import KINDS

MAX_SECONDS, MAX_WAIT_S, MAX_MIB = 20.0, 300.0, 2048


class Watched:
    """A worker process that is started again when it dies, hangs or has run a thousand cases."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.process, self.count = folder, None, 0

    def _start(self) -> None:
        here = Path(__file__).parent
        path = f"{here}{os.pathsep}{os.environ.get('PYTHONPATH', here.parents[1])}"
        own = {"SAF_GEN_SCENES": self.folder / "scenes", "XDG_CONFIG_HOME": self.folder.parent / "config"}
        env = {**os.environ, "PYTHONPATH": path, **{name: str(value) for name, value in own.items()}}
        self.process: Any = subprocess.Popen(
            [sys.executable, str(here / "worker.py"), str(self.folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=(self.folder.parent / "stderr.txt").open("a"), text=True, env=env,
        )  # fmt: skip
        assert self.process.stdout.readline() == "ready\n", "the worker does not start"
        self.count = 0

    def stop(self) -> None:
        if self.process:
            self.process.kill()
            self.process.wait()
            self.process = None

    def run(self, case: dict[str, Any]) -> dict[str, Any]:
        if self.process is None:
            self._start()
        self.count += 1
        begun, used = time.monotonic(), self._cpu()
        self.process.stdin.write(json.dumps(case) + "\n")
        self.process.stdin.flush()
        while not select.select([self.process.stdout], [], [], 0.2)[0]:
            if self._cpu() - used > MAX_SECONDS or time.monotonic() - begun > MAX_WAIT_S:
                return self._ended({**case, "faults": [f"no end after {self._cpu() - used:.0f} s of processor time"]})
        line = self.process.stdout.readline()
        if not line:
            return self._ended({**case, "faults": [f"the process died: {self.process.wait()}"]})
        result = json.loads(line)
        result["seconds"] = self._cpu() - used
        if result["peak_mib"] > MAX_MIB:
            result["faults"].append(f"{result['peak_mib']} MiB")
        if self.count >= 1000 or result["peak_mib"] > MAX_MIB:
            self.stop()
        return result

    def _ended(self, result: dict[str, Any]) -> dict[str, Any]:
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)  # the samples may be left half changed
        return result

    def _cpu(self) -> float:
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def print_line(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def fuzz() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each kind")
    parser.add_argument("--kind", action="append", choices=[kind.name for kind in KINDS])
    parser.add_argument("--only", type=int, help="run only this case, and print its full result")
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "saf-gen-fuzz")
    options = parser.parse_args()
    names = options.kind or [kind.name for kind in KINDS]
    each = -(-options.inputs // len(names))
    numbers = [options.only] if options.only is not None else range(options.first, options.first + each)
    worker, tally, slowest = Watched(options.folder / "samples"), collections.Counter(), (0.0, "")
    options.folder.mkdir(parents=True, exist_ok=True)
    faults = 0
    try:
        for name in names:
            codes: collections.Counter[int] = collections.Counter()
            for number in numbers:
                result = worker.run({"kind": name, "seed": options.seed, "number": number})
                codes[result.get("code", -1)] += 1
                slowest = max(slowest, (result.get("seconds", 0.0), f"{name} {number}"))
                if options.only is not None or result["faults"]:
                    faults += bool(result["faults"])
                    print_line(json.dumps(result, indent=1, ensure_ascii=False))
            tally[name] = sum(codes.values())
            print_line(f"{name}: {tally[name]} inputs, exit codes {dict(sorted(codes.items()))}")
    finally:
        worker.stop()
    what = f"{sum(tally.values())} inputs of {len(names)} kinds, seed {options.seed}"
    print_line(f"{what}: {faults} faults; slowest {slowest[0]:.1f} s ({slowest[1]})")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(fuzz())
