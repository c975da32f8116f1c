"""Kinds of input: their files, the changes that corrupt them, and the commands that read them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random

import fuzz_changes as changes

Call = Callable[..., int]
Change = Callable[[Path, bytes, Random], bytes]


@dataclass(frozen=True)
class Kind:
    """A kind of input; its commands are run in the folder of the samples, with the file in place of {}."""

    name: str
    files: tuple[str, ...]
    commands: tuple[str, ...]
    changes: tuple[Change, ...]


def _plain(change: Callable[[bytes, Random], bytes]) -> Change:
    return lambda path, raw, rng: change(raw, rng)


YAML = _plain(changes.change_yaml)
JSON = _plain(changes.change_json)
TEXT = _plain(changes.change_text)
BYTES = _plain(changes.change_bytes)
MEMBER, HDF5 = changes.change_member, changes.change_hdf5
WRITTEN = (YAML, YAML, YAML, TEXT, TEXT, BYTES)
PROGRAMS = (JSON, JSON, JSON, TEXT, BYTES)
EVALUATE = "evaluate data --method sd+argmax --out out"

KINDS = (
    Kind("recipe", ("recipe.yaml",), ("recipes check {}", "generate {} --dry-run --out out"), WRITTEN),
    Kind("scene card", ("scenes/own/scene.yaml",), ("recipes check recipe.yaml", "scenes list", "!scene"), WRITTEN),
    Kind(
        "scene's geometry",
        (
            "scenes/own/scene.xml",
            "scenes/own/scene.xml",
            "scenes/own/meshes/card.obj",
            "scenes/own/meshes/card.ply",
            "scenes/own/textures/print.png",
        ),
        ("!scene", "recipes check recipe.yaml", "scenes new copied --from scenes/own/scene.xml"),
        (TEXT, TEXT, BYTES),
    ),
    Kind(
        "sensor file", ("sensor.yaml",), ("sensors check {}", "sensors show {}", "recipes check recipe.yaml"), WRITTEN
    ),
    Kind("actuator file", ("actuator.yaml",), ("!actuator",), WRITTEN),
    Kind(
        "stream",
        ("data/test/a.h5",),
        ("inspect {}", "verify data", "score {} --measure sd --window 50", "inspect {} --json", EVALUATE),
        (HDF5, HDF5, HDF5, BYTES),
    ),
    Kind("manifest", ("data/manifest.json",), ("verify data", EVALUATE), PROGRAMS),
    Kind(
        "records", ("judged/records.jsonl",), ("leaderboard merge {} --out out", "leaderboard merge judged"), PROGRAMS
    ),
    Kind(
        "tuned file", ("tuned.json",), ("methods show @{}", "evaluate data --method @{} --out out"), (*PROGRAMS, JSON)
    ),
    Kind("predictions", ("answers.jsonl",), ("evaluate data --predictions {} --out out",), PROGRAMS),
    Kind("list of methods", ("methods.txt",), ("evaluate data --methods {} --out out",), (TEXT, TEXT, BYTES)),
    Kind(
        "log of lens or light",
        ("lens.csv", "light.csv", "gain.csv"),
        (
            "import camera.dat --layout 416 --out out.h5 --focus lens.csv --light light.csv --truth 0.42",
            "recipes check recipe.yaml",
        ),
        (TEXT, TEXT, BYTES),
    ),
    Kind(
        "camera file",
        ("camera.dat", "saf/config.xlsx", "saf/one.dat"),
        ("import camera.dat --layout 416 --out out.h5", "!saf"),
        (BYTES, BYTES, MEMBER),
    ),
    Kind(
        "array of a camera",
        ("frames.npy", "frames.npz", "old.mat", "new.mat"),
        ("import {} --axes TYX --out out.h5",),
        (BYTES, BYTES, MEMBER, HDF5),
    ),
    Kind(
        "pictures",
        ("pictures/0.png", "pictures/1.png", "pictures/3.tif", "frames.npy"),
        (
            "encode pictures --out out.h5 --rate 2000 --sensor ideal --transfer srgb",
            "encode frames.npy --out out.h5 --rate 2000 --linear",
        ),
        (BYTES,),
    ),
    Kind("focal stack", ("stack.exr", "slices.exr"), ("!stack",), (BYTES,)),
    Kind(
        "mesh of a new scene",
        ("scenes/own/meshes/card.ply", "scenes/own/meshes/card.obj"),
        ("scenes new copied --from {}",),
        (TEXT, BYTES),
    ),
)
