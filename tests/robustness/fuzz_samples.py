"""A folder with a valid sample of every kind of file that may be untrusted or mistyped."""

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import scipy.io
from openpyxl import Workbook
from PIL import Image

import saf_gen
from saf_gen.benchmark.method_spec import TunedMethod, TuningTrial, format_tuned
from saf_gen.core import exr
from saf_gen.core.region import REGIONS
from saf_gen.stream.dataset import index_folder

PACKAGE = Path(saf_gen.__file__).parent
MARK = "SECRET-OF-THIS-MACHINE"
"""Content of a file next to the dataset, which must not appear in anything that is printed or written."""
PLANTED = "PLANTED"
"""File that planted code would write."""
CODE = f"import pathlib\npathlib.Path({PLANTED!r}).write_text('run')\nclass Evil:\n    pass\n"
PLANNED = {"scene": "own", "scene_motion": "static"}
ROWS, COLUMNS, FRAMES = 24, 32, 400
RECIPE = """\
name: small
seed: 3
camera: {sensor: sensor.yaml, frames: 400, exposure: {mean_rate: 0.2}}
focus: {drive: image_distance, positions: 9, motion: {kind: steps, count: 5, natural_hz: 900, damping: 0.7}}
render: {samples: 16, max_depth: 3}
lights:
  constant: {kind: constant}
  continuous: {kind: ramp, from: 0.5, to: 2.0}
  logged: {kind: from_csv, file: gain.csv}
  lamp_only:
    lamp: {kind: steps, every_s: 0.005, levels: [1.0, 0.4, 2.0]}
splits:
  test: {scenes: [own], lights: [constant, continuous, logged, lamp_only], repeats: 2}
"""


def write_samples(folder: Path, call: Callable[..., int]) -> None:
    """Write all samples into ``folder``; ``call`` runs a command there."""
    (folder / "secret.txt").write_text(f"{MARK}\n" * 100)
    (folder / "evil.py").write_text(CODE)
    _write_dataset(folder / "data")
    assert call("evaluate", "data", "--method", "sd+argmax", "--method", "er_sumsq+sgfs_code", "--out", "judged") == 0
    trials = (TuningTrial("sd+argmax:window=50", 0.5, 1.25), TuningTrial("sd+argmax:window=100", None, None))
    tuned = TunedMethod("sd+argmax:window=50", "data", "train", "recorded", "", REGIONS[0], 2, "0" * 12, "0.1", trials)
    (folder / "tuned.json").write_text(format_tuned(tuned))
    answers = [
        {
            "method": "net",
            "sequence": f"test-{name}",
            "frame": 200.5,
            "frames_seen": 300,
            "trace": [1, 2.5],
            "note": "n",
        }
        for name in "ab"
    ]
    (folder / "answers.jsonl").write_text("".join(json.dumps(one) + "\n" for one in answers))
    (folder / "methods.txt").write_text(
        "# mine\nsd+argmax\nsd_code+sgfs_code:dt=50  # faster\ntenengrad+argmax@frame\n"
    )
    (folder / "lens.csv").write_text("frame,position\n" + "".join(f"{n * 10},{n / 50:.3f}\n" for n in range(50)))
    (folder / "light.csv").write_text(
        "seconds,lamp,sky\n" + "".join(f"{n / 1000},{1 + n / 9:.3f},1\n" for n in range(9))
    )
    shutil.copy(PACKAGE / "camera/sensors/ideal.yaml", folder / "sensor.yaml")
    shutil.copy(PACKAGE / "optics/actuators/presets/voice_coil_hall.yaml", folder / "actuator.yaml")
    (folder / "recipe.yaml").write_text(RECIPE)
    (folder / "gain.csv").write_text("time_s,gain\n0,1\n0.01,2\n0.02,0.5\n")
    _write_scene(folder / "scenes" / "own")
    _write_foreign(folder)
    planes = np.random.default_rng(3).random((9, ROWS, COLUMNS), np.float32)
    named = {f"focus.{k:04d}": plane for k, plane in enumerate(planes)}
    exr.write_planes(folder / "stack.exr", named, attributes={"format": "1", "unit": "W"})
    half = {name: plane.astype(np.float16) for name, plane in named.items()}
    exr.write_plane_blocks(folder / "slices.exr", half, attributes={"format": "1", "exponent": "3"})


def _write_dataset(folder: Path) -> None:
    rng = np.random.default_rng(5)
    lens = np.linspace(0, 1, FRAMES)
    yy, xx = np.mgrid[:ROWS, :COLUMNS]
    for name, at in (("a", 0.4), ("b", 0.7)):
        sharp = np.exp(-(((lens - at) / 0.1) ** 2))[:, None, None]
        rate = 0.2 + 0.15 * sharp * ((xx // 2 + yy // 2) % 2 * 2 - 1)
        saf_gen.write_stream(
            folder / "test" / f"{name}.h5",
            (rng.random((FRAMES, ROWS, COLUMNS)) < rate).astype(np.uint8),
            readout_hz=20_000,
            focus_position=lens,
            gain=np.ones((FRAMES, 2)),
            light_names=("sun", "sky"),
            truth={
                "position": at, "depth_of_focus": (at - 0.05, at + 0.05), "frame": at * (FRAMES - 1),
                "depth": np.ones((ROWS, COLUMNS)), "target": (xx > 4) & (yy > 4), "sharpness": np.arange(9.0),
            },
            provenance={"recipe": RECIPE, "seed": "3", "sequence": json.dumps(PLANNED)},
        )  # fmt: skip
    index_folder(folder)


def _write_scene(folder: Path) -> None:
    shutil.copytree(PACKAGE / "authoring/templates/xml", folder)
    card = folder / "scene.yaml"
    card.write_text(card.read_text().replace("NAME  ", "own  "))
    (folder / "meshes" / "card.ply").write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
        b"property float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        + np.array([0, 0, 0, 0.1, 0, 0, 0, 0.1, 0], "<f4").tobytes()
        + b"\x03"
        + np.array([0, 1, 2], "<i4").tobytes()
    )
    xml = folder / "scene.xml"
    camera = (
        '<sensor type="perspective" id="camera"><float name="fov" value="20"/><transform name="to_world">'
        '<lookat origin="0, 0, 0.5" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>'
    )
    second = camera + '<shape type="ply" id="leaf"><string name="filename" value="meshes/card.ply"/></shape>'
    xml.write_text(xml.read_text().replace("</scene>", f"{second}\n</scene>"))


def _write_foreign(folder: Path) -> None:
    """Write recordings and pictures in formats of other programs."""
    rng = np.random.default_rng(7)
    frames = (rng.random((16, ROWS, COLUMNS)) < 0.3).astype(np.uint8)
    raw = rng.integers(0, 256, (3, 250, 52), np.uint8)
    raw[..., 50:] = 0
    (folder / "camera.dat").write_bytes(raw.tobytes())
    np.save(folder / "frames.npy", frames)
    np.savez_compressed(folder / "frames.npz", spk=frames, other=np.arange(3))
    scipy.io.savemat(folder / "old.mat", {"spk": np.moveaxis(frames, 0, -1)})
    with h5py.File(folder / "new.mat", "w", userblock_size=512) as file:
        file.create_dataset("spk", data=frames.transpose(0, 2, 1), chunks=(4, COLUMNS, ROWS), compression="gzip")
    saf = folder / "saf"
    saf.mkdir()
    (saf / "one.dat").write_bytes(raw.tobytes())
    cells = [["id", "scene name", "frames", "focal frame", "dt", "path"], ["1", "cat", "3", "2", "50", "one.dat"]]
    book = Workbook()
    for row in cells:
        book.active.append(row)
    book.save(saf / "config.xlsx")
    pictures = folder / "pictures"
    pictures.mkdir()
    for n in range(3):
        Image.fromarray(rng.integers(1, 255, (ROWS, COLUMNS), np.uint8)).save(pictures / f"{n}.png")
    Image.fromarray(rng.integers(1, 255, (ROWS, COLUMNS, 3), np.uint8)).convert("L").save(pictures / "3.tif")


def repack(path: Path, change: Callable[[bytes], bytes], *, pick: int) -> bytes:
    """Return an archive (.npz, .xlsx) with the content of one member changed and correct checksums."""
    out = path.with_suffix(".repacked")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        names = old.namelist()
        for number, name in enumerate(names):
            data = old.read(name)
            new.writestr(name, change(data) if number == pick % len(names) else data)
    text = out.read_bytes()
    out.unlink()
    return text
