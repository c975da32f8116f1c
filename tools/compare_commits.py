"""Run the same jobs with two commits and compare everything that they write: a refactoring must move no number.

    python tools/compare_commits.py BEFORE AFTER [--work DIR] [--only JOB ...] [--allow FILE_OR_COLUMN ...]

BEFORE and AFTER are commits, of which worktrees are made in DIR, or folders of checkouts. This interpreter runs the
commands of both, with PYTHONPATH set to the checkout. Every file is compared: each channel of a focal stack, each array
and text of a stream, each key of a record, and other files by line; what MASKED and PAGE_MASKS name is left out. The
exit code is 0 if nothing differs, 1 if something differs or a command fails, and 2 for bad input.

Outputs stay in DIR, in folders whose names hold a digest of the checkout, so that a run that was stopped goes on and
a commit is run once. Renders are equal bit for bit on one machine only: run both commits on the same one. The jobs:

moving      three scenes, two also moving, on 40 × 64 pixels, under three lights: all measures and searches
quickstart  recipes/quickstart.yaml: the methods that run by default, and a stream that is scored, exported and imported
v2          ten sequences of the test split of recipes/saf_bench-v2.yaml at full size, one of a moving scene; only
            commits that generate this benchmark can run it
"""

import argparse
import csv
import difflib
import filecmp
import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
SHOWN_FILES, SHOWN_LINES, SHOWN_CHARACTERS = 25, 8, 180

MASKED = {
    "seconds": "computing time, in records and tables",
    "s": "the same column in tables for readers",
    "reference_rate": "speed of the machine, in records",
    "over_declared": "computing time divided by what is declared, in tables",
    "over declared": "the same column in tables for readers",
    "machine": "processor, and versions of Python and numpy",
    "machines": "the same in leaderboard.json",
    "host": "name of the machine in verification.json",
    "version": "version of saf_gen",
    "versions": "versions of packages in the provenance of a stream",
    "datePublished": "today, in croissant.json",
    "code": "digest of the source of a method, which a refactoring changes",
    "checksum": "of a line or file, including what is left out here",
    "provenance_sha256": "the same, of the provenance of a stream",
    "answers": "digest in verification.json of records with their code",
    "signature": "of verification.json, including the machine",
}
"""Keys, columns and texts that may differ between two runs or commits that compute the same, with the reason."""
PAGE_MASKS = {
    r"(?<=Made by saf_gen )[\w.]+": "version of saf_gen",
    r'(?s)(?<=<section id="methods">).*?(?=</section>)': "docstrings, class names and source code of the methods",
}
"""Pieces of index.html that may differ, with the reason."""

MEASURES = """
brenner cen change_rate dct_energy_ratio energy_of_laplacian entropy er_count er_sumsq gaussian_derivative gradient_code
mfdct_code mfdct_lee mid_band_power modified_laplacian normalised_variance octave_structure sd sd_calibrated sd_code
sd_debiased squared_gradient structure_calibrated tenengrad variance variance_of_laplacian vollath_f4 vollath_f5
wavelet_ratio tenengrad_n sd_tfi gradient_code_n_tfi
"""
ESTIMATING = """
sd+argmax:refine=parabola sd_code+egs sd_code+egs_code sd+naive sd_code+sgfs_printed gradient_code+sgfs_code
sd_code+sgfs_causal tenengrad+sign_change change_rate+valley structure_calibrated+photon_aware octave_structure+peak_fit
"""
COMMANDING = """
sd+coarse_to_fine sd+fibonacci sd+golden_section sd+hill_climb sd+rule_based sd+ternary gradient_code_n+hill_climb
sd_code+sgfs_causal structure_calibrated+photon_aware octave_structure+peak_fit
"""
FEW = "sd+argmax gradient_code+egs_code sd_code+sgfs_code cen+argmax sd_calibrated+photon_aware"
FEW_IN_LOOP = "sd+golden_section gradient_code_n+hill_climb sd_code+sgfs_causal octave_structure+peak_fit"
MOVING = """\
name: moving
seed: 3
camera: {sensor: small.yaml, frames: 4000, exposure: {mean_rate: 0.2}}
focus: {positions: 17}
render: {samples: 16, max_depth: 3, slice_samples: 16, slices_per_s: 40, whole_slices: 0.2}
lights:
  constant: {kind: constant}
  continuous: {kind: ramp, from: 0.5, to: 2.0}
  sudden: {kind: steps, every_s: 0.04, levels: [1.0, 0.4, 2.0]}
splits:
  test:
    scenes: [two_depths, turntable, usaf_microscope]
    lights: [constant, continuous, sudden]
    scene_motion: [static, dynamic]
    at_rest: [usaf_microscope]
"""
SMALL = {"name": "small", "rows": "40", "columns": "64", "pitch_m": "6.0e-5"}
"""What the small sensor has in place of the values of vidar_400x250."""
V2 = (1, 14, 27, 76, 83, 96, 115, 122, 147, 172)
"""Numbers of ten of the 180 test sequences, to be made as shards of one: bottle-constant, cardiac_muscle-brighter,
circuit_board-darker, face-dynamic-sudden, fan-mains, food-clouds, pebbles-constant, rain_window-brighter,
speculars-darker and usaf_target-sudden."""


def methods(names: str, *, search: str = "") -> str:
    """Return the options that name these methods, or these measures with a search."""
    return " ".join(f"--method {name}{search}" for name in names.split())


STREAM = "quickstart/test/camel-sudden-00.h5"
JOBS = {
    "moving": (
        "generate moving.yaml --out moving",
        "verify moving",
        f"evaluate moving --split test {methods(MEASURES, search='+argmax')} {methods(ESTIMATING)}",
        f"evaluate moving --split test --track closed_loop --budget 200 {methods(COMMANDING)}",
        "leaderboard verify moving/evaluation",
        "leaderboard verify moving/evaluation-closed-loop --budget 200",
    ),
    "quickstart": (
        "generate {recipes}/quickstart.yaml --out quickstart",
        "verify quickstart",
        "evaluate quickstart --split test",
        f"evaluate quickstart --split test --track closed_loop {methods(FEW_IN_LOOP)}",
        *(f"score {STREAM} --measure {name} --window 100 --out {name}.csv" for name in ("sd_calibrated", "cen_tfi")),
        f"export {STREAM} --out camel.dat",
        "import camel.dat --out imported.h5",
    ),
    "v2": (
        *(f"generate {{recipes}}/saf_bench-v2.yaml --split test --shard {n}/180 --out saf_bench-v2" for n in V2),
        "verify saf_bench-v2",
        f"evaluate saf_bench-v2 --split test {methods(FEW)}",
        f"evaluate saf_bench-v2 --split test --track closed_loop --budget 200 {methods(FEW_IN_LOOP)}",
    ),
}
"""Arguments of saf-gen, in the order in which they run; paths are relative to the folder of the job."""


@dataclass(frozen=True)
class Side:
    """One of the two checkouts, and the folder with its outputs."""

    name: str
    checkout: Path
    folder: Path

    def run(self, job: str) -> str:
        """Run the commands of a job that have not succeeded before, and return the time that all of them took.

        Raises CalledProcessError if a command fails.
        """
        folder, done_file = self.folder / job, self.folder / f"{job}.json"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "moving.yaml").write_text(MOVING, encoding="utf-8")
        (folder / "small.yaml").write_text(small_sensor(self.checkout), encoding="utf-8")
        done = json.loads(done_file.read_text()) if done_file.exists() else {}
        for number, command in enumerate(JOBS[job], start=1):
            if command not in done:
                say(f"{self.name} {job} [{number}/{len(JOBS[job])}] {command:.90}")
                arguments, begin = shlex.split(command.format(recipes=self.checkout / "recipes")), os.times()
                self.call("-m", "saf_gen", *arguments, folder=folder)
                spent = [now - then for now, then in zip(os.times(), begin, strict=True)]
                done[command] = {"seconds": spent[4], "of_processors": spent[2] + spent[3]}
                done_file.write_text(json.dumps(done, indent=1))
        total = [sum(done[command][key] for command in JOBS[job]) for key in ("seconds", "of_processors")]
        return f"{total[0]:.0f} s, {total[1]:.0f} s of processors"

    def call(self, *arguments: str, folder: Path) -> str:
        """Run the interpreter, without settings of the user that might change results, and return what it printed.

        Numba does not notice that a kernel in another file has changed, so that compiled kernels are not shared.
        """
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("SAF_GEN_", "PYTHON"))}
        own = {"PYTHONPATH": self.checkout, "XDG_CONFIG_HOME": self.folder / "config"}
        own["NUMBA_CACHE_DIR"] = self.folder / "kernels"
        environment = {**kept, **{key: str(path) for key, path in own.items()}}
        command = [sys.executable, *arguments]
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout


def small_sensor(checkout: Path) -> str:
    """Return the sensor of the small job: vidar_400x250 of the checkout with few, large pixels."""
    text = next((checkout / "saf_gen").rglob("vidar_400x250.yaml")).read_text(encoding="utf-8")
    for key, value in SMALL.items():
        text = re.sub(rf"(?m)^{key}: *\S+", f"{key}: {value}", text, count=1)
    return text


def compare_folders(before: Path, after: Path, *, allowed: Collection[str] = ()) -> dict[str, list[str]]:
    """Return the lines that differ by file, each with its sign.

    ``allowed`` names files (or patterns of files), columns and keys that are left out in addition to MASKED.
    """
    sides = [{str(p.relative_to(root)): p for p in root.rglob("*") if p.is_file()} for root in (before, after)]
    found = {}
    for name in sorted(set().union(*sides)):
        if any(Path(name).match(pattern) for pattern in allowed):
            continue
        missing = [f"{sign} there is no such file" for sign, side in zip("-+", sides, strict=True) if name not in side]
        found[name] = missing or compare_files(*(side[name] for side in sides), dropped={*MASKED, *allowed})
    return {name: lines for name, lines in found.items() if lines}


def compare_files(before: Path, after: Path, *, dropped: Collection[str]) -> list[str]:
    """Return the lines that differ between two files, each with its sign; empty if the files are equal."""
    if filecmp.cmp(before, after, shallow=False):
        return []
    old, new = (list(READERS.get(path.suffix, read_plain)(path, dropped)) for path in (before, after))
    return [line for line in [*difflib.unified_diff(old, new, n=0, lineterm="")][2:] if line[0] in "-+"]


def read_plain(path: Path, dropped: Collection[str]) -> Iterator[str]:
    """Yield the lines of a text, or the digest of any other file."""
    content = path.read_bytes()
    try:
        yield from content.decode().splitlines(keepends=True)
    except UnicodeDecodeError:
        yield sha256(content)


def read_json(path: Path, dropped: Collection[str]) -> Iterator[str]:
    def keep(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        return {key: value for key, value in pairs if key not in dropped}

    document = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=keep)
    yield from json.dumps(document, indent=1, ensure_ascii=False).splitlines()


def read_records(path: Path, dropped: Collection[str]) -> Iterator[str]:
    """Yield a line for each key of each record, sorted by method, sequence and region."""
    records = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    for record in sorted(records, key=lambda r: (r["method"], r["sequence"], r["region"])):
        for key, value in record.items():
            if key not in dropped:
                yield f"{record['method']}, {record['sequence']}, {record['region']}: {key} = {value!r}"


def read_csv(path: Path, dropped: Collection[str]) -> Iterator[str]:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    yield ", ".join(name for name in header if name not in dropped)
    for number, row in enumerate(rows, start=1):
        yield from (f"row {number}: {k} = {v}" for k, v in zip(header, row, strict=True) if k not in dropped)


def read_markdown(path: Path, dropped: Collection[str]) -> Iterator[str]:
    """Yield the lines, those of tables cell by cell."""
    headings: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        headings = [] if not line.startswith("|") else headings or cells
        if not headings or len(cells) != len(headings):
            yield line
        else:
            yield from (f"{key}: {cell}" for key, cell in zip(headings, cells, strict=True) if key not in dropped)


def read_page(path: Path, dropped: Collection[str]) -> Iterator[str]:
    """Yield the lines of a page, those of tables cell by cell, and those of data list by list."""
    text = path.read_text(encoding="utf-8")
    for pattern in PAGE_MASKS:
        text = re.sub(pattern, "...", text)
    headings: list[str] = []
    for row in re.split(r"(?=<tr\b)|(?<=</tr>)|(?<=\],)", text):
        first, *cells = re.split(r"(?=<t[hd]\b)", row)
        if re.search(r"<th\b", row):
            headings = [re.sub("<.*?>", "", cell).strip() for cell in cells]
        keys = headings if len(headings) == len(cells) else [""] * len(cells)
        for piece in (first, *(cell for key, cell in zip(keys, cells, strict=True) if key not in dropped)):
            yield from piece.splitlines()


def read_exr(path: Path, dropped: Collection[str]) -> Iterator[str]:
    """Yield the text attributes and the digest of the pixels of every channel of every part."""
    import OpenEXR

    for number, part in enumerate(OpenEXR.File(str(path), separate_channels=True).parts):
        yield from (f"{number}: {k} = {v}" for k, v in sorted(part.header.items()) if isinstance(v, str))
        for name, channel in sorted(part.channels.items()):
            yield f"{number}: pixels of {name}, {describe_array(channel.pixels)}"


def read_stream(path: Path, dropped: Collection[str]) -> Iterator[str]:
    """Yield the attributes, arrays and texts of a stream."""
    import h5py

    lines: list[str] = []

    def visit(name: str, item: Any) -> None:
        lines.extend(f"{name}: {key} = {value!r}" for key, value in item.attrs.items() if key not in dropped)
        if isinstance(item, h5py.Dataset) and name.rpartition("/")[2] not in dropped:
            value = item[()]
            if isinstance(value, bytes):
                lines.extend(f"{name}: {line}" for line in value.decode().splitlines())
            else:
                is_short = value.size < 9 or value.dtype == object
                lines.append(f"{name}: {value.tolist() if is_short else describe_array(value)}")

    with h5py.File(path) as file:
        visit("", file)
        file.visititems(visit)
    yield from lines


def describe_array(array: Any) -> str:
    return f"{array.dtype} {array.shape} {sha256(array.tobytes())}"


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


READERS: dict[str, Callable[[Path, Collection[str]], Iterator[str]]] = {
    ".json": read_json, ".jsonl": read_records, ".csv": read_csv, ".md": read_markdown, ".html": read_page,
    ".exr": read_exr, ".h5": read_stream,
}  # fmt: skip


def find_checkout(given: str, work: Path) -> Path:
    """Return the folder of a checkout, or a worktree of a commit; raise ValueError if ``given`` is neither."""
    if (Path(given) / "saf_gen/__main__.py").is_file():
        return Path(given).resolve()
    git = ["git", "-C", str(ROOT)]
    found = subprocess.run([*git, "rev-parse", "--verify", "--quiet", f"{given}^{{commit}}"], capture_output=True)
    if found.returncode:
        raise ValueError(f"{given!r} is no commit and no folder with saf_gen; git log --oneline lists commits")
    commit = found.stdout.decode().strip()
    folder = work / "worktrees" / commit[:12]
    if not folder.is_dir():
        subprocess.run([*git, "worktree", "add", "--quiet", "--force", "--detach", str(folder), commit], check=True)
    return folder.resolve()


def open_side(name: str, given: str, work: Path) -> Side:
    """Return a side; raise ValueError if its checkout does not exist or the interpreter imports another package."""
    checkout = find_checkout(given, work)
    inside = [p for kind in ("saf_gen", "scenes", "recipes") for p in sorted((checkout / kind).rglob("*"))]
    paths = [p for p in inside if p.is_file() and "__pycache__" not in p.parts]
    digests = [MOVING, *(f"{p.relative_to(checkout)} {sha256(p.read_bytes())}" for p in paths)]
    side = Side(name, checkout, work / f"{name}-{checkout.name}-{sha256(' '.join(digests).encode())[:12]}")
    side.folder.mkdir(parents=True, exist_ok=True)
    try:
        found = side.call("-c", "import saf_gen; print(saf_gen.__file__)", folder=side.folder).strip()
    except subprocess.CalledProcessError as error:
        raise ValueError(f"{given!r} cannot be imported: {error.stderr.splitlines()[-1]}") from error
    if not Path(found).is_relative_to(checkout):
        raise ValueError(f"{sys.executable} imports {found} although PYTHONPATH is {checkout}")
    return side


def compare_job(job: str, sides: Sequence[Side], *, allowed: Collection[str]) -> tuple[str, bool]:
    """Run and compare a job, print what differs, and return its line of the summary and whether all is equal."""
    try:
        times = [f"{side.name} {side.run(job)}" for side in sides]
    except subprocess.CalledProcessError as error:
        last = "\n  ".join((error.stdout + error.stderr).splitlines()[-SHOWN_LINES:])
        say(f"FAILED {job}, exit code {error.returncode}: {shlex.join(error.cmd)}\n  {last}")
        return "a command failed", False
    say(f"comparing {job}")
    folders = [side.folder / job for side in sides]
    found = compare_folders(*folders, allowed=allowed)
    for number, (name, lines) in enumerate(found.items()):
        shown = [f"{line:.{SHOWN_CHARACTERS}}".rstrip() for line in lines[:SHOWN_LINES]] if number < SHOWN_FILES else []
        say("\n  ".join([f"DIFFERS {job}/{name}, {len(lines)} lines", *shown]))
    suffixes = [path.suffix for path in folders[0].rglob("*") if path.is_file()]
    counts = f"{len(suffixes)} files ({suffixes.count('.h5')} streams, {suffixes.count('.exr')} of focal stacks)"
    return f"{counts}: {len(found) or 'none'} differ; {'; '.join(times)}", not found


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)


def main(given: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", help="commit, or folder of a checkout")
    parser.add_argument("after", help="commit, or folder of a checkout")
    parser.add_argument("--work", type=Path, default=ROOT / "build/compare", help="folder for worktrees and outputs")
    parser.add_argument("--only", action="append", choices=JOBS, help="run this job; repeatable (default: all)")
    allow = "file, pattern of files, column or key that is left out, because it went on purpose"
    parser.add_argument("--allow", nargs="+", action="extend", default=[], metavar="FILE_OR_COLUMN", help=allow)
    options = parser.parse_args(given)
    work = options.work.resolve()
    try:
        sides = [open_side("before", options.before, work), open_side("after", options.after, work)]
    except ValueError as error:
        parser.error(str(error))
    results = {job: compare_job(job, sides, allowed=options.allow) for job in options.only or JOBS}
    for job, (line, _) in results.items():
        say(f"{job:10} {line}")
    return int(not all(equal for _, equal in results.values()))


if __name__ == "__main__":
    sys.exit(main())
