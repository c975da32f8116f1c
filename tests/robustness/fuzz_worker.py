"""A process that runs commands on corrupted files one after the other, and reports to its parent how each ended."""

import io
import os
import re
import resource
import shutil
import sys
import traceback
import unicodedata
import warnings
from contextlib import redirect_stderr, redirect_stdout
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

import fuzz_changes as changes
import fuzz_samples as samples
from fuzz_kinds import KINDS, Kind

from saf_gen.cli import main
from saf_gen.errors import SafGenError

MAX_BYTES = 8 << 30


def call(*arguments: str) -> tuple[int, str, str]:
    """Run a command in this process, and return its exit code, standard output and standard error."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            if arguments[0].startswith("!"):
                code = _call_directly(arguments[0][1:])
            else:
                main(list(arguments))
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, out.getvalue(), err.getvalue()


def _call_directly(what: str) -> int:
    """Call code that a command would reach only after minutes, and return an exit code."""
    try:
        if what == "scene":
            from saf_gen.render.backend import activate_backend
            from saf_gen.render.mitsuba_scene import load_lit_scene, scene_dict
            from saf_gen.scene.scene_folder import load_scene

            activate_backend("scalar")
            described = scene_dict(load_scene(Path("scenes/own")))
            load_lit_scene(described, ("lamp",), max_depth=3)
        elif what == "actuator":
            import numpy as np

            from saf_gen.optics.actuators import get_actuator
            from saf_gen.optics.actuators.actuated_lens import ActuatedLens

            lens = ActuatedLens(get_actuator("actuator.yaml"), readout_hz=20_000, seed=1, start=0.5)
            lens.command(0.7)
            assert np.isfinite(lens.run(100)).all()
        elif what == "stack":
            from saf_gen.core.exr import read_planes

            for path in ("stack.exr", "slices.exr"):
                read_planes(Path(path), ["focus.0003"])
                read_planes(Path(path))
        elif what == "saf":
            main(["import", "saf", "--out", "out"])
    except SafGenError as error:
        sys.stderr.write(f"saf-gen: {error}\n")
        return error.exit_code
    return 0


def find_faults(code: int, out: str, err: str) -> list[str]:
    """Return descriptions of behaviour that a user should not see."""
    faults = []
    lines = err.splitlines()
    if code not in (0, 1, 2):
        faults.append(f"exit code {code}")
    if code == 2 and (len(lines) != 1 or not lines[0].startswith("saf-gen:")):
        faults.append(f"{len(lines)} lines of an error")
    if code == 1 and not all(line.startswith(("saf-gen:", "warning:", "evaluate ")) for line in lines):
        faults.append("other lines than errors")
    if re.search(r"\wWarning\b", err) or "Traceback" in err:  # "Warning: " alone is ours
        faults.append("a warning of Python")
    if any(unicodedata.category(c) in ("Cc", "Cf", "Cs") and c not in "\n\t" for c in out + err):
        faults.append("a control character on the terminal")
    if len(err) > 8000:
        faults.append(f"{len(err)} characters of an error")
    if samples.MARK in out + err:
        faults.append("the content of another file was shown")
    return faults


def _listing(root: Path) -> set[str]:
    return {str(p.relative_to(root)) for p in root.rglob("*")}


def run_case(kind: Kind, seed: int, number: int) -> dict[str, Any]:
    """Corrupt a file of a kind with the random numbers of (seed, number), run a command, and restore the file.

    Returns a description of the case, with its faults.
    """
    rng, root = Random(f"{seed} {kind.name} {number}"), Path.cwd()
    name = rng.choice(kind.files)
    path = sorted(root.glob(name))[0]
    raw, command = path.read_bytes(), rng.choice(kind.commands)
    keep = path.with_name(f"{path.name}.keep")
    shutil.copy2(path, keep)
    result: dict[str, Any] = {"kind": kind.name, "number": number, "file": name, "command": command}
    try:
        if rng.random() < 0.03:
            result["change"] = "another kind of file"
            changes.put_other_kind(path, rng)
        else:
            change = rng.choice(kind.changes)
            if change is changes.change_member and path.suffix not in (".npz", ".xlsx"):
                change = kind.changes[0]
            if change is changes.change_hdf5 and raw[:4] != b"\x89HDF" and path.name != "new.mat":
                change = kind.changes[0]
            result["change"] = getattr(change, "__name__", "text")
            path.write_bytes(change(path, raw, rng))
        before = _listing(root)
        Path("/proc/self/clear_refs").write_text("5")  # resets the peak memory
        try:
            code, out, err = call(*command.format(path.relative_to(root)).split())
        except BaseException as error:  # noqa: BLE001 - a user would see any of them as a traceback
            code, out, err = -1, "", ""
            result["trace"] = traceback.format_exc()[-3000:]
            result["faults"] = [f"traceback: {type(error).__name__}"]
        else:
            result["faults"] = find_faults(code, out, err)
        peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
        result |= {"code": code, "line": err.strip()[-400:], "peak_mib": int(peak.split()[1]) >> 10}
        after = _listing(root)
        done = {one for one in after - before if not command.startswith("fetch") or one.endswith("manifest.json")}
        if code == 2 and done:  # a fetch may leave files, because it resumes later, but it writes its manifest last
            result["faults"].append(f"written in spite of an error: {sorted(done)[:3]}")
        if any(".part" in one or ".evaluation." in one for one in after - before):
            result["faults"].append("a leftover")
        if (root / samples.PLANTED).exists():
            result["faults"].append("planted code was run")
            (root / samples.PLANTED).unlink()
    finally:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        keep.replace(path)
        for left in ("out", "out.h5", "scenes/copied"):
            shutil.rmtree(root / left, ignore_errors=True)
            (root / left).unlink(missing_ok=True)
    return result


def _check_samples(root: Path) -> None:
    """Raise ValueError if a command rejects all valid samples of a kind, because fuzzing it would test nothing."""
    for kind in KINDS:
        for command in kind.commands:
            files = [next(root.glob(file)) for file in kind.files] if "{}" in command else [root]
            ends = [call(*command.format(file).split()) for file in files]
            if all(code != 0 for code, _, _ in ends):
                raise ValueError(f"{kind.name}: {command}: {ends}")
            for left in ("out", "out.h5", "scenes/copied"):
                shutil.rmtree(root / left, ignore_errors=True)
                (root / left).unlink(missing_ok=True)


def write_samples_in(root: Path, *, check: bool = False) -> None:
    """Make ``root`` the working folder, and write the samples there unless they exist."""
    root.mkdir(parents=True, exist_ok=True)
    os.chdir(root)
    if not (root / "slices.exr").exists():
        samples.write_samples(root, lambda *arguments: call(*arguments)[0])
        if check:
            _check_samples(root)


def serve(root: Path, cases: Connection) -> None:
    """Run the cases that arrive through a pipe, in a folder of samples, and send back a result for each."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_BYTES, MAX_BYTES))
    os.environ.update(SAF_GEN_SCENES=str(root / "scenes"), XDG_CONFIG_HOME=str(root.parent / "config"))
    with (root.parent / "stderr.txt").open("a") as stderr:
        os.dup2(stderr.fileno(), 2)
    for ignored in (ResourceWarning, DeprecationWarning, PendingDeprecationWarning):  # as Python itself does
        warnings.simplefilter("ignore", ignored)
    by_name = {kind.name: kind for kind in KINDS}
    write_samples_in(root, check=True)
    cases.send("ready")
    while True:
        kind, seed, number = cases.recv()
        cases.send(run_case(by_name[kind], seed, number))
