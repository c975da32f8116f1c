"""Hold one commit against another: what a refactoring must not move is made with both, on one machine, and compared.

    python tools/baseline.py BEFORE AFTER [--gate 1|2] [--out DIR [--keep]] [--strict]

Gate 1, a minute: the digests of all scenes, and the keys of all stacks and the fingerprints of all sequences of the
recipes that a commit ships. Nothing is rendered and no script of a scene runs.

Gate 2, about ten minutes a commit on two free cores, and all of gate 1: content_sha256 of recordings, and of what other
cameras record of them; and answers, traces, errors and costs of all methods on these, in both tracks. The datasets:

quickstart   recipes/quickstart.yaml: at rest, full size; recaptured by an event, a photon and a frame camera, which
             are judged on the recorded track
moving       MOVING below: two moving scenes, three lights, slices for the closed loop; recaptured by the first two
ten          recipes/saf_bench.yaml under another name: ten members of its test split
variety      recipes/variety.yaml, if the commit ships it

Every commit is checked out into a worktree of git, and this interpreter runs its own code with PYTHONPATH; nothing is
installed. A commit given twice is checked out and run twice. With --out, datasets and result.json stay in a folder for
each commit, and --keep takes the results that are there. Pictures are equal bit for bit on one machine only: results of
another processor or of other versions of the libraries are refused.

The exit code is 0 if all that both commits have is equal, 1 if something differs or a command fails in AFTER alone, and
2 for bad input. What only one commit has (a recipe, a method, a key of records) is listed, and fails with --strict.
"""

import argparse
import hashlib
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
SHOWN = 3  # names a row
LIBRARIES = ("numpy", "scipy", "numba", "mitsuba", "drjit", "h5py")

NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "answer": {"position": ("position",), "frame": ("frame",), "status": ("status",)},
    "trace": {"trace": ("trace",)},
    "error": {name: (name,) for name in ("truth", "truth_frame", "error", "error_dof", "time_to_focus_s")},
    "cost": {"frames_seen": ("frames_seen",), "lens_travel": ("lens_travel",), "operations": ("operations",)},
}
"""Values of a record that are compared, by the row of the table that counts them, each with the keys under which a
commit may have it; the first key that a record has counts, and a dot leads into a part of it. Seconds, versions, hosts,
notes and digests of code are not among them."""
WHO = {"method": ("method",), "sequence": ("sequence",)}
"""What tells the records of an evaluation apart, likewise."""

PROBE = """
import json, saf_gen
from saf_gen.generate.recipe import recipe_names
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.scene.scene_folder import find_scene, scene_names
def tell(*values): print(json.dumps(values))
tell("file", saf_gen.__file__)
for name in scene_names():
    tell("scenes", "digest", name, find_scene(name).digest)
for name in recipe_names():
    try:
        for s in resolve_recipe(name).sequences:
            tell(f"recipe {name}", "stack keys", s.planned.id, [spec.key for stack in s.stacks for spec in stack.specs])
            tell(f"recipe {name}", "fingerprints", s.planned.id, s.fingerprint(""))
    except saf_gen.errors.BadInput as error:
        tell("refused", f"recipe {name}", str(error))
"""
"""What gate 1 asks of a commit; the one place that uses the package and not its command line."""

MOVING = """\
name: moving
seed: 3
camera: {sensor: vidar_128x128, frames: 2000, exposure: {mean_rate: 0.2}}
focus: {positions: 17, motion: {kind: sweep}}
render: {samples: 16, max_depth: 3, slice_samples: 16, slices_per_s: 50, whole_slices: 0.05}
lights:
  constant: {kind: constant}
  continuous: {kind: ramp, from: 0.5, to: 2.0}
  sudden: {kind: steps, every_s: 0.02, levels: [1.0, 0.4, 2.0]}
splits:
  test: {scenes: [pendulum_clock, usaf_microscope], lights: [constant, continuous, sudden], scene_motion: [dynamic]}
"""
CAMERAS = {"events": "davis346", "photons": "qvga_spad", "frames": "imx273"}
SPIKES_ONLY = (
    *("change_rate", "sd_calibrated", "sd_debiased", "structure_calibrated"),
    *("elp", "pbf", "peak_fit", "photon_aware"),
)
"""Measures and searches that suit no other camera, as do measures of intervals, ``_tfi``."""
BESIDE = ("sd_code", "octave_structure")
"""Measures with which every search runs; the second where the dataset is small."""
PAIRS = (("sd_calibrated", "photon_aware"), ("structure_calibrated", "photon_aware"), ("change_rate", "valley"))
"""Methods in addition, for spikes."""


DATASETS = {"quickstart": ("events", "photons", "frames"), "moving": ("events", "photons"), "ten": (), "variety": ()}
"""Datasets of gate 2, each with the cameras that record it again."""
LONG = {"ten": ("--budget", "100")}
"""Datasets on which fewer methods run, with options for the closed loop."""


@dataclass
class Result:
    """What a commit gave: values by dataset, kind and name, the commands that failed, and on which machine."""

    commit: str
    machine: str
    gate: int
    seconds: float = 0.0
    values: dict[str, dict[str, dict[str, Any]]] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    def add(self, dataset: str, kind: str, name: str, value: Any) -> None:
        self.values.setdefault(dataset, {}).setdefault(kind, {})[name] = value


class Row(NamedTuple):
    """How one kind of values of a dataset compares: names that differ, and that only one commit has."""

    dataset: str
    kind: str
    equal: int
    different: list[str]
    before: list[str]
    after: list[str]


class Commit:
    """A checkout of a commit, and the folder in which its own code runs."""

    def __init__(self, commit: str, folder: Path, gate: int) -> None:
        self.checkout, self.work = folder / "checkout", folder / "work"
        self.result = Result(commit, describe_machine(), gate)
        self.work.mkdir(parents=True, exist_ok=True)
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("SAF_GEN_", "PYTHON"))}
        # Numba does not notice that a kernel in another file has changed, so that compiled kernels are not shared.
        own = {"PYTHONPATH": self.checkout, "XDG_CONFIG_HOME": folder / "config", "NUMBA_CACHE_DIR": folder / "kernels"}
        self.environment = {**kept, **{key: str(path) for key, path in own.items()}}

    def python(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, *arguments]
        return subprocess.run(command, cwd=self.work, env=self.environment, capture_output=True, text=True)

    def saf_gen(self, *arguments: str) -> str:
        """Run a command and return what it printed; a failure is noted, with its last line."""
        text = " ".join(arguments)
        say(f"{self.result.commit[:8]} {text}")
        done = self.python("-m", "saf_gen", *arguments)
        if done.returncode:
            last = (done.stderr.splitlines() or [""])[-1]
            self.result.failed[text] = f"exit code {done.returncode}: {last}"
            say(f"  {self.result.failed[text]}")
        return done.stdout

    def plan(self) -> None:
        """Gate 1."""
        say(f"{self.result.commit[:8]} recipes")
        done = self.python("-c", PROBE)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        if done.returncode or not lines:
            raise ValueError(f"{self.result.commit} cannot be asked for its recipes: {done.stderr.strip()[-500:]}")
        if not Path(lines[0][1]).is_relative_to(self.checkout):
            raise ValueError(f"{sys.executable} imports {lines[0][1]} although PYTHONPATH is {self.checkout}")
        for dataset, kind, name, *value in lines[1:]:
            if dataset == "refused":
                self.result.failed[kind] = name
            else:
                self.result.add(dataset, kind, name, hashlib.sha256(json.dumps(value[0]).encode()).hexdigest())

    def generate_and_evaluate(self) -> None:
        """Gate 2."""
        has_list = (self.checkout / "saf_gen/cli/command.py").exists()  # before it, `methods` alone printed the list
        listed = json.loads(self.saf_gen("methods", *(["list"] if has_list else []), "--json"))
        for dataset, cameras in DATASETS.items():
            if (recipe := read_recipe(dataset, self.checkout / "recipes")) is None:
                continue
            (self.work / f"{dataset}.yaml").write_text(recipe, encoding="utf-8")
            self.saf_gen("generate", f"{dataset}.yaml", "--out", dataset)
            self.judge(dataset, listed, camera="spikes", all_forms=dataset not in LONG)
            for camera in cameras:
                self.saf_gen("recapture", dataset, "--sensor", CAMERAS[camera], "--out", f"{dataset}_{camera}")
                self.judge(f"{dataset}_{camera}", listed, camera=camera, all_forms=False)

    def judge(self, name: str, listed: dict[str, Any], *, camera: str, all_forms: bool) -> None:
        """Verify a dataset, take the digests of its recordings, also by a recipe's other cameras, and run methods."""
        import h5py

        self.saf_gen("verify", name)
        folders = [self.work / name, *sorted((self.work / name / "cameras").glob("*"))]
        entries = [(folder, e) for folder in folders for e in read_json(folder / "manifest.json").get("sequences", ())]
        for folder, entry in entries:
            kind = "content" if folder == folders[0] else f"content, {folder.name}"
            with h5py.File(folder / entry["file"]) as file:
                self.result.add(name, kind, entry["id"], str(file.attrs["content_sha256"]))
        # A closed loop of the full-size pictures of events alone would take as long as all else.
        tracks = ["recorded", "closed_loop"][: 1 if name.startswith("quickstart_") else 2]
        for track in tracks if entries else ():
            methods = choose_methods(listed, camera=camera, track=track, all_forms=all_forms and track == "recorded")
            out, options = f"{name}-{track}", LONG.get(name, ()) if track == "closed_loop" else ()
            (self.work / f"{out}.txt").write_text("\n".join(methods), encoding="utf-8")
            options = ("--split", "all", "--track", track, "--methods", f"{out}.txt", "--out", out, *options)
            self.saf_gen("evaluate", name, *options)
            for kind, item, value in read_records(self.work / out / "records.jsonl"):
                self.result.add(name, f"{track}: {kind}", item, value)


def choose_methods(listed: dict[str, Any], *, camera: str, track: str, all_forms: bool) -> list[str]:
    """Return every measure with one search and every search with one or two measures, of those that are ``listed``.

    ``listed`` is what ``saf-gen methods list --json`` prints; with ``all_forms``, measures are taken in all forms.
    """
    best = "argmax" if track == "recorded" else "golden_section"
    suited = {kind: [m for m in listed[kind] if camera == "spikes" or m["name"] not in SPIKES_ONLY] for kind in listed}
    measures = [m["name"] + form for m in suited["measures"] for form in ("", *m["forms"].split() * all_forms)]
    if camera == "frames":  # their number is small, so that a window is of three
        return [f"{measure}+{best}:window=3" for measure in measures]
    own = [m for m in suited["searches"] if camera == "events" or not m["name"].endswith("_events")]
    searches = [m["name"] for m in own if track == "closed_loop" or "commands" not in m["kind"]]
    pairs = [(measure, best) for measure in measures]
    pairs += [(measure, search) for measure in BESIDE[: 1 + all_forms] for search in searches]
    pairs += [(measure, search) for measure, search in PAIRS if measure in measures and search in searches]
    return list(dict.fromkeys("+".join(pair) for pair in pairs))


def read_recipe(name: str, folder: Path) -> str | None:
    """Return the text of a recipe of gate 2, or None if a commit does not ship what it is made of."""
    import yaml

    if name == "moving":
        return MOVING
    path = folder / ("saf_bench.yaml" if name == "ten" else f"{name}.yaml")
    text = path.read_text(encoding="utf-8") if path.is_file() else None
    if name == "ten" and text is not None:
        recipe = yaml.safe_load(text)
        split = {**recipe["splits"]["test"], "members": 10}
        text = yaml.safe_dump({**recipe, "name": name, "splits": {"test": split}}, sort_keys=False)
    return text


def read_json(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def read_records(path: Path) -> Iterator[tuple[str, str, Any]]:
    """Yield the kind, the name and the value of each value of NAMES that the records of an evaluation have."""
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        record = json.loads(line)
        who = [str(value) for keys in WHO.values() for value in look_up(record, keys)]
        for kind, names in NAMES.items():
            for name, keys in names.items():
                for value in look_up(record, keys):
                    yield kind, f"{' '.join(who)} {name}", value


def look_up(record: Mapping[str, Any], keys: Sequence[str]) -> list[Any]:
    """Return a list of the value of the first of these keys that a record has; an empty one if it has none."""
    for key in keys:
        part, _, rest = key.partition(".")
        if part in record:
            return look_up(record[part], [rest]) if rest else [record[part]]
    return []


def describe_machine() -> str:
    """Return the processor with its model, and the versions of what computes: with the same, bits are equal."""
    info = Path("/proc/cpuinfo")
    lines = [line.partition(":") for line in info.read_text().split("\n\n")[0].splitlines()] if info.is_file() else []
    facts = {key.strip(): value.strip() for key, _, value in lines}
    model = [facts[key] for key in ("model name", "cpu family", "model", "stepping") if key in facts]
    flags = hashlib.sha256(facts.get("flags", "").encode()).hexdigest()[:8]
    installed = {one.name: one.version for one in distributions() if one.name in LIBRARIES}
    versions = [f"Python {platform.python_version()}", *(f"{name} {installed.get(name)}" for name in LIBRARIES)]
    return f"{' '.join(model) or platform.processor()}, flags {flags}; {', '.join(versions)}"


def compare(before: Result, after: Result) -> list[Row]:
    """Return the rows of two results; raise ValueError if they are of different machines."""
    if before.machine != after.machine:
        raise ValueError(f"the results are of two machines, {before.machine} and {after.machine}: run both on one")
    rows, sides = [], (before.values, after.values)
    for dataset in dict.fromkeys([*before.values, *after.values]):
        kinds = [side.get(dataset, {}) for side in sides]
        for kind in dict.fromkeys([*kinds[0], *kinds[1]]):
            old, new = (side.get(kind, {}) for side in kinds)
            different = [name for name in old if name in new and old[name] != new[name]]
            equal = sum(name in new for name in old) - len(different)
            only = [[name for name in a if name not in b] for a, b in ((old, new), (new, old))]
            rows.append(Row(dataset, kind, equal, different, *only))
    return rows


def format_table(rows: Sequence[Row]) -> str:
    """Return the rows as a Markdown table; a name that only one commit has is signed."""
    lines = [["dataset", "what", "equal", "different", "only before", "only after", "names"], ["---"] * 7]
    for row in rows:
        signed = (("", row.different), ("−", row.before), ("+", row.after))
        names = [f"{sign}{name}" for sign, listed in signed for name in listed[:SHOWN]]
        counts = [row.equal, len(row.different), len(row.before), len(row.after)]
        lines.append([row.dataset, row.kind, *map(str, counts), ", ".join(names)])
    widths = [max(len(line[n]) for line in lines) for n in range(len(lines[0]) - 1)]
    return "\n".join(f"| {' | '.join([*map(str.ljust, line[:-1], widths), line[-1]])} |" for line in lines)


def find_commit(given: str) -> str:
    """Return the hash of a commit; raise ValueError if there is none."""
    found = git("rev-parse", "--verify", "--quiet", f"{given}^{{commit}}", check=False)
    if found.returncode:
        raise ValueError(f"{given!r} is no commit; git log --oneline lists commits")
    return found.stdout.strip()


def git(*arguments: str, check: bool = True) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(["git", "-C", str(ROOT), *arguments], check=check, capture_output=True, text=True)


def find_result(commit: str, folder: Path, *, gate: int, keep: bool) -> Result:
    """Return the result of a commit, from its folder with ``keep`` if that has one, and otherwise by running it."""
    file = folder / "result.json"
    if keep and (kept := read_json(file)) and kept["gate"] == gate:
        say(f"{commit[:8]} has results in {folder}")
        return Result(**kept)
    if not keep:
        shutil.rmtree(folder, ignore_errors=True)
    git("worktree", "prune")
    begin, side = time.monotonic(), Commit(commit, folder, gate)
    if not side.checkout.exists():
        git("worktree", "add", "--detach", str(side.checkout), commit)
    side.plan()
    if gate == 2:
        side.generate_and_evaluate()
    side.result.seconds = round(time.monotonic() - begin, 1)
    file.write_text(json.dumps(vars(side.result)), encoding="utf-8")
    git("worktree", "remove", "--force", str(side.checkout))
    return side.result


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def report(before: Result, after: Result, *, strict: bool = False) -> int:
    """Print how two results compare, and return the exit code."""
    rows = compare(before, after)
    times = f"{before.seconds:.0f} and {after.seconds:.0f} s"
    print(f"{before.commit[:12]} and {after.commit[:12]}, gate {after.gate}, {times}, {after.machine}\n")
    print(f"{format_table(rows)}\n")
    for which, result in (("before", before), ("after", after)):
        for command, why in result.failed.items():
            print(f"failed {which}: {command}: {why}")
    only = sum(len(row.before) + len(row.after) for row in rows)
    print(f"{sum(row.equal for row in rows)} equal, {sum(len(row.different) for row in rows)} different, "
          f"{only} in one commit only")  # fmt: skip
    moved = any(row.different or (row.before and row.after and not row.equal) for row in rows)  # or nothing in common
    return int(bool(moved or after.failed.keys() - before.failed.keys() or (strict and only)))


def main(given: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", help="commit")
    parser.add_argument("after", help="commit; the same is checked out and run twice")
    parser.add_argument("--gate", type=int, choices=(1, 2), default=1, help="2 also generates and evaluates")
    parser.add_argument("--out", type=Path, help="folder for what both make (default: a temporary one)")
    parser.add_argument("--keep", action="store_true", help="take results of these commits that are in --out")
    parser.add_argument("--strict", action="store_true", help="fail for what only one commit has, too")
    options = parser.parse_args(given)
    if options.keep and options.out is None:
        parser.error("--keep takes results from --out: name a folder with it")
    with tempfile.TemporaryDirectory(prefix="saf-gen-baseline-") as temporary:
        out = (options.out or Path(temporary)).resolve()
        try:
            commits = [find_commit(options.before), find_commit(options.after)]
            folders = [out / commits[0][:12], out / f"{commits[1][:12]}{'-again' * (commits[0] == commits[1])}"]
            results = [
                find_result(commit, folder, gate=options.gate, keep=options.keep)
                for commit, folder in zip(commits, folders, strict=True)
            ]
            return report(*results, strict=options.strict)
        except ValueError as error:
            parser.error(str(error))


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the command that runs is ended, too
    sys.exit(main())
