"""Feed saf-gen corrupted input of every kind, and report behaviour that a user should never see.

    python tests/robustness/fuzz.py --inputs 10000 --seed 17

There are seventeen kinds of input: recipe, scene card, geometry of a scene (XML, meshes, texture), sensor file,
actuator file, stream, manifest, records, tuned file, predictions, list of methods, logs of lens and light, camera files
(raw, SAF's folder), arrays of cameras (NumPy, MATLAB), pictures, focal stacks, meshes of new scenes. Each
input is a valid sample (fuzz_samples.py) with something changed (fuzz_changes.py): hostile values, broken text, bytes,
links, archives with correct checksums, pipes and devices instead of files.

A fault is a traceback, an error of more than one line, an exit code other than 0, 1 and 2, 20 s of processor time or
5 minutes without an end, 2 GiB of memory, a process that dies, a control character on the terminal, the content of
another file, planted code that was run, or a file written in spite of an error. (seed, kind, number) identifies a case,
and --only repeats it.
"""

import argparse
import collections
import json
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import fuzz_worker
from fuzz_kinds import KINDS

MAX_SECONDS, MAX_WAIT_S, MAX_MIB = 20.0, 300.0, 2048


class Watched:
    """A worker process that is started again when it dies, hangs or has run a thousand cases."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.process, self.count = folder, None, 0

    def _start(self) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        self.process: Any = spawn.Process(target=fuzz_worker.serve, args=(self.folder, theirs), daemon=True)
        self.process.start()
        theirs.close()  # so that the end of the worker is seen
        assert self.pipe.recv() == "ready", "the worker does not start"
        self.count = 0

    def stop(self) -> None:
        if self.process:
            self.process.kill()
            self.process.join()
            self.process = None

    def run(self, kind: str, seed: int, number: int) -> dict[str, Any]:
        if self.process is None:
            self._start()
        self.count += 1
        begun, used = time.monotonic(), self._cpu()
        self.pipe.send((kind, seed, number))
        case = {"kind": kind, "seed": seed, "number": number}
        while not self.pipe.poll(0.2):
            if self._cpu() - used > MAX_SECONDS or time.monotonic() - begun > MAX_WAIT_S:
                return self._ended({**case, "faults": [f"no end after {self._cpu() - used:.0f} s of processor time"]})
        try:
            result: dict[str, Any] = self.pipe.recv()
        except EOFError:
            self.process.join()
            return self._ended({**case, "faults": [f"the process died: {self.process.exitcode}"]})
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


def fuzz(
    numbers: Sequence[int],
    seed: int,
    *,
    folder: Path,
    kinds: Sequence[str] = (),
    show_all: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> list[dict[str, Any]]:
    """Run the cases with these numbers of each kind, and return the results that have faults, or all of them."""
    worker, kept, count = Watched(folder / "samples"), [], 0
    folder.mkdir(parents=True, exist_ok=True)
    names = kinds or [kind.name for kind in KINDS]
    try:
        for name in names:
            codes: collections.Counter[int] = collections.Counter()
            for number in numbers:
                result = worker.run(name, seed, number)
                codes[result.get("code", -1)] += 1
                if show_all or result["faults"]:
                    kept.append(result)
            count += sum(codes.values())
            tell(f"{name}: {sum(codes.values())} inputs, exit codes {dict(sorted(codes.items()))}")
    finally:
        worker.stop()
    tell(f"{count} inputs of {len(names)} kinds, seed {seed}")
    return kept


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each kind")
    parser.add_argument("--kind", action="append", choices=[kind.name for kind in KINDS])
    parser.add_argument("--only", type=int, help="run only this case, and print its full result")
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "saf-gen-fuzz")
    options = parser.parse_args()
    each, alone = -(-options.inputs // len(options.kind or KINDS)), options.only is not None
    found = fuzz(
        [options.only] if alone else range(options.first, options.first + each),
        options.seed,
        folder=options.folder,
        kinds=options.kind or (),
        show_all=alone,
        tell=lambda line: print(line, flush=True),
    )
    for result in found:
        print(json.dumps(result, indent=1, ensure_ascii=False))
    faults = sum(bool(result["faults"]) for result in found)
    print(f"{faults} faults")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
