"""What this machine's card does: the renderer's tests and times in one file, to paste into an issue (make gpu-report).

The tests run with the variant cuda, and the bench ``stack`` on the card, then on the cores of the same machine. The
file names the hardware and the versions, and no host, user or folder. The exit code is 1 if a part has failed.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from saf_gen.core.cores import describe_machine
from saf_gen.core.extras import installed_version

ROOT = Path(__file__).parents[2]
TESTS = (
    "-m",
    "pytest",
    "tests/render",
    "--variant",
    "cuda",
    "-m",
    "not long and not browser",
    "-n",
    "4",
    "-rf",
    "--tb=line",
)
BENCH = ("-m", "studies.speed", "stack")
QUERY = ("nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader")
PACKAGES = ("mitsuba", "drjit", "numpy", "numba")


@dataclass(frozen=True)
class Part:
    """One part of the report: its title, the exit code of its command, its seconds and the lines that it printed."""

    title: str
    code: int
    seconds: float
    lines: list[str]

    def __str__(self) -> str:
        """The part in Markdown."""
        how = "done" if self.code == 0 else f"**failed** (exit code {self.code})"
        return "\n".join((f"## {self.title}: {how}, {self.seconds:.0f} s", "", "```text", *self.lines, "```", ""))


def run_part(title: str, command: Sequence[str], *, hide_card: bool = False) -> Part:
    """Run a command of Python in the checkout, and return its figures, its counts and what failed."""
    environment = os.environ | ({"CUDA_VISIBLE_DEVICES": ""} if hide_card else {})
    print(f"{title} ...", flush=True)
    begin = perf_counter()
    run = subprocess.run(
        [sys.executable, *command], cwd=ROOT, env=environment, capture_output=True, text=True, errors="replace"
    )
    said = (run.stdout + run.stderr).replace(str(ROOT), ".").replace(str(Path.home()), "~").splitlines()
    lines = [
        line for line in said if line.strip(".sFE ")[:1] not in ("", "[") and not line.startswith(("=", "bringing"))
    ]
    return Part(title, run.returncode, perf_counter() - begin, lines[-60:])


def describe_card() -> str:
    """Return the names, drivers and memories of the cards, as the driver's own program states them."""
    try:
        found = subprocess.run(QUERY, capture_output=True, text=True, errors="replace")
    except FileNotFoundError:
        return "nvidia-smi is not there"
    return "; ".join((found.stdout or found.stderr).split("\n")).strip("; ")


def main(argv: Sequence[str] | None = None) -> int:
    """Write the report, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies.speed.card", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("gpu-report.md"), help="file to write (default: %(default)s)")
    target = parser.parse_args(argv).out
    from saf_gen.render import backend

    machine = backend.probe_backends()
    card = "traces" if machine.cuda else machine.card_problem or "there is no card that Mitsuba can use"
    versions = ", ".join(f"{name} {installed_version(name)}" for name in PACKAGES)
    head = (("card", describe_card()), ("a ray on it", card), ("LLVM", machine.llvm_description))
    rows = [f"| {name} | {text} |" for name, text in (*head, ("machine", describe_machine()), ("versions", versions))]
    planned = [("Tests of the renderer on the card", TESTS, False), ("Times on the card", BENCH, False)]
    planned = planned * machine.cuda + [("Times on the cores", BENCH, True)] * machine.llvm_usable
    parts: list[Part] = []
    text = "\n".join(("# saf-gen on a card", "", "| | |", "|---|---|", *rows, "", ""))
    target.write_text(text)
    for title, command, hide_card in planned:  # written after each part, so that an interrupted run leaves the others
        parts.append(run_part(title, command, hide_card=hide_card))
        target.write_text(text + "\n".join(map(str, parts)))
    print(f"wrote {target}")
    return int(not machine.cuda or any(part.code for part in parts))


if __name__ == "__main__":
    sys.exit(main())
