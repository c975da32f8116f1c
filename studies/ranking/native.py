"""Cameras as they are: every camera behind the same lens, in the same light, with its own pixels.

    python -m studies.ranking.native --out FOLDER [--camera NAME ...] [--members 24] [--lux L [--seconds S]]

Each camera has its own pitch, fill factor and quantum efficiency, and sees the same field, 1.28 mm wide and high, of
the same members and lights at equal lux. A stack is rendered on the pixels of each camera, by a recipe whose spike
sensor has these pixels; the camera then records it. So that the light is the same, the threshold of that sensor
is as much higher or lower as its pixels collect more or less. Errors are in micrometres between the sensor and the
sharp image of the target, because a depth of focus is as deep as pixels are large. FOLDER keeps what is finished, and
a second run goes on there.

With ``--lux``, the target throws so much light of 555 nm on the sensor, in focus and at gain 1: behind f/2, 1 lux is a
dim room (30 lux), and 625 lux is daylight (20,000). Each level records the same stacks, and its recordings are removed
once they are judged. ``--seconds`` is the time of the sweep, so that cameras collect in the dark what they need.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import RECORDS_FILE, Record, read_records, write_records
from saf_gen.camera import Sensor, get_sensor
from saf_gen.camera.exposure import electrons_per_irradiance, firing_rate
from saf_gen.camera.frames import FrameSensor
from saf_gen.camera.photons import SpadSensor
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.files import check_writable, unwritable, write_text
from saf_gen.errors import BadInput
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics import drive_from_dict
from saf_gen.stack.recapture import CAMERAS, STACKS, Recapture
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_file import open_stream
from studies.ranking.cameras import SEED, interval

FIELD_M = 1.28e-3  # side of the square that all cameras see: 64 pixels of a spike camera
BASE = "vidar_128x128"  # the spike camera, in whose rate the light is set
LUMENS_PER_W = 683.0  # at 555 nm
DIM_SHOT_HZ = ((5.0, 10.0), (25.0, 5.0))  # events of noise per pixel and second up to so many lux, from DND21 and v2e
BIN = 4  # pixels of imx273 in a row, and in a column, that make one
ROW_S, PAUSE_ROWS = 396 / 74.25e6, 42  # of imx273 at 12 bits: seconds per row, and rows between two frames
LOG_HZ = 2_000  # readouts per second of a sensor whose spikes nobody looks at: they log the lens, and small files do
SAMPLES, FEWEST_SAMPLES = 96, 64  # per pixel of the spike camera, and of any camera
POSITIONS = 80  # steps of the lens between its ends for the spike camera; finer for finer pixels, as the depth of focus
SPLIT = "test"
DRAWS = 2000
METHODS: Mapping[str, Sequence[str]] = {
    BASE: ["fine_structure+bell_vote", "octave_structure+argmax", "gradient_code_n+egs_code"],
    "qvga_spad": ["fine_structure+bell_vote", "octave_structure+argmax", "gradient_code_n+egs_code"],
    "imx273": ["mfdct_lee_n+argmax:window=2", "fine_structure+bell_vote", "tenengrad_n+argmax:window=2"],
    "davis346": ["er_count+event_reversal", "er_count+elp_events", "gradient_code_n+egs_code"],
}
"""The default method and the best others of each camera, from studies/results/cameras.md; two frames take about as long
as three did."""


def rate_at(lux: float) -> float:
    """Return the mean rate of the spike camera, with its dark current, at a light of ``lux`` on its pixels."""
    sensor = get_sensor(BASE)
    charge = lux / LUMENS_PER_W * electrons_per_irradiance(sensor)
    return float(firing_rate(np.array(charge + sensor.mean_dark_e), sensor))


def recipe(members: int, pixels: Sensor, *, lux: float | None = None, seconds: float = 1.0) -> dict[str, Any]:
    """Return the recipe of a camera with these pixels; members, motions, light and rates are those of all cameras."""
    finer = get_sensor(BASE).pitch_m / pixels.pitch_m
    return {
        "name": "native",
        "seed": 57,
        "camera": {
            "sensor": "pixels.yaml",
            "frames": round(pixels.readout_hz * seconds),
            "exposure": {"mean_rate": {"log_uniform": [0.02, 0.4]} if lux is None else rate_at(lux)},
        },
        "focus": {
            "positions": round(POSITIONS * finer) + 1,
            "motion": {
                "choice": [
                    {"kind": "sweep"},
                    {"kind": "sweep", "from": 1.0, "to": 0.0},
                    {"kind": "sweep_and_return", "dwell_s": 0.05},
                ]
            },
        },
        "render": {"samples": max(round(SAMPLES / finer**2), FEWEST_SAMPLES)},
        "lights": {
            "constant": {"kind": "constant"},
            "brighter": {"kind": "ramp", "from": 1.0, "to": {"log_uniform": [1.5, 8]}},
            "darker": {"kind": "ramp", "from": 1.0, "to": {"log_uniform": [0.125, 0.66]}},
            "mains": {"kind": "flicker", "hz": {"choice": [100, 120]}, "depth": {"uniform": [0.1, 0.9]}},
        },
        "splits": {
            SPLIT: {
                "scenes": ["assorted_moving"],
                "members": members,
                "lights": ["constant", "brighter", "darker", "mains"],
                "lights_each": 2,
            }
        },
    }


def pixels_of(camera: Any) -> Sensor:
    """Return the spike sensor with the pixels of a camera, over the field, that fires as often in the same light."""
    base = get_sensor(BASE)
    side = round(FIELD_M / camera.pitch_m)
    area = camera.pitch_m**2 * camera.fill_factor * camera.quantum_efficiency
    collected = area / (base.pitch_m**2 * base.fill_factor * base.quantum_efficiency)
    hz = LOG_HZ if isinstance(camera, SpadSensor | FrameSensor) else base.readout_hz
    return replace(
        base,
        name=f"{camera.name}_pixels",
        rows=side,
        columns=side,
        pitch_m=camera.pitch_m,
        fill_factor=camera.fill_factor,
        quantum_efficiency=camera.quantum_efficiency,
        readout_hz=hz,
        threshold_e=base.threshold_e * collected * base.readout_hz / hz,
    )


def camera_of(name: str, lux: float | None = None) -> Any:
    """Return a camera by name; a frame camera reads the rows of the field, which sets its rate.

    The noise of an event camera is that which was published for so much light.
    """
    if name == BASE:
        return get_sensor(name)
    if name == "davis346":
        noise = next((hz for most, hz in DIM_SHOT_HZ if lux is not None and lux <= most), None)
        return get_sensor(name, kind="events", **({} if noise is None else {"shot_hz": noise}))
    if name == "qvga_spad":
        return get_sensor(name, kind="photons")
    one = get_sensor(name, kind="frames")
    rows = round(FIELD_M / one.pitch_m)
    hz = round(1 / ((rows + PAUSE_ROWS) * ROW_S), 1)
    return get_sensor(
        name,
        kind="frames",
        rows=rows // BIN,
        columns=rows // BIN,
        pitch_m=BIN * one.pitch_m,
        readout_hz=hz,
        exposure_s=min(one.exposure_s, 1 / hz),
        full_well_e=BIN**2 * one.full_well_e,
        read_noise_e=BIN * one.read_noise_e,
        bits=one.bits + 4,
        black_level_dn=BIN**2 * one.black_level_dn,
        dark_e_per_s=BIN**2 * one.dark_e_per_s,
        response_rms=one.response_rms / BIN,
    )


@dataclass(frozen=True)
class Answer:
    """How far a method was off, in micrometres of image distance and in depths of focus; None without an answer."""

    error_um: float | None
    error_dof: float | None


def run(
    name: str, *, folder: Path, members: int, lux: float | None = None, seconds: float = 1.0, region: str = "target"
) -> dict[str, dict[str, Answer]]:
    """Render, record and judge one camera in ``folder``; return its answers by method and sequence.

    Raises BadInput if a sequence fails, or the folder cannot be written to.
    """
    camera, level = camera_of(name, lux), "dataset" if lux is None else f"{lux:g}-lux-{seconds:g}-s"
    if lux is not None and (earlier := _kept_answers(folder / f"{level}-{region}.json", METHODS[name], members)):
        return earlier
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    pixels = pixels_of(camera)
    write_text(folder / "pixels.yaml", yaml.safe_dump({"kind": "spikes", **pixels.as_dict()}, sort_keys=False))
    made_by = recipe(members, pixels) if lux is None else recipe(members, pixels, lux=lux, seconds=seconds)
    write_text(folder / "recipe.yaml", yaml.safe_dump(made_by, sort_keys=False))
    dataset = folder / level
    if lux is not None:
        (folder / STACKS).mkdir(exist_ok=True)
        dataset.mkdir(exist_ok=True)
        if not (dataset / STACKS).is_symlink():
            (dataset / STACKS).symlink_to(Path("..") / STACKS, target_is_directory=True)
    made = generate(resolve_recipe(folder / "recipe.yaml"), dataset, tell=print)
    _refuse_failures(made.failed)
    judged = dataset if name == BASE else dataset / CAMERAS / name
    manifest = read_manifest(dataset)
    if name != BASE:
        given = name
        if camera != get_sensor(name, kind=camera.kind):
            given = str(folder / "camera.yaml")
            write_text(Path(given), yaml.safe_dump({"kind": camera.kind, **camera.as_dict()}, sort_keys=False))
        other = Recapture.by(given)
        done = other.record_all(dataset, manifest.sequences, target=judged, tell=print)
        _refuse_failures(done.failed)
        other.finish(dataset, manifest, target=judged)
    kept, recorded = (
        (folder if lux is None else dataset) / RECORDS_FILE,
        {entry.content_sha256 for entry in read_manifest(judged).sequences},
    )
    found = read_records(kept) if kept.exists() else []
    expected = {(method, region, data) for method in METHODS[name] for data in recorded}
    if {(record.who.method, record.who.region, record.what.data) for record in found} != expected:
        result = evaluate(judged, methods=METHODS[name], split=SPLIT, region=region, draw=False)
        _refuse_failures({failure.sequence: failure.problem for failure in result.failures})
        found = list(result.records)
        write_records(kept, found)
    drives = {entry.id: _drive(dataset / entry.file) for entry in manifest.sequences}
    answers: dict[str, dict[str, Answer]] = {}
    for record in found:
        if record.what.obstacle is None and record.judgement.truth is not None:
            answers.setdefault(record.who.method, {})[record.what.sequence] = _answer(
                record, drives[record.what.sequence]
            )
    if lux is not None:
        write_records(folder / f"{level}-{region}.jsonl", found)
        held = {method: {name: asdict(one) for name, one in of.items()} for method, of in answers.items()}
        write_text(folder / f"{level}-{region}.json", json.dumps({"members": members, "answers": held}))
        shutil.rmtree(dataset)  # the stacks are elsewhere
    return answers


def _kept_answers(path: Path, methods: Sequence[str], members: int) -> dict[str, dict[str, Answer]]:
    """Return the answers of a finished level; empty if it is of other methods or members, or not there."""
    if not path.exists():
        return {}
    held: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    if held["members"] != members or set(held["answers"]) != set(methods):
        return {}
    return {method: {name: Answer(**one) for name, one in of.items()} for method, of in held["answers"].items()}


def _refuse_failures(failed: Mapping[str, object]) -> None:
    """Raise BadInput if anything failed, because a table without it would compare other recordings."""
    if failed:
        raise BadInput("; ".join(f"{what}: {problem}" for what, problem in failed.items()))


def _drive(path: Path) -> Any:
    with open_stream(path) as stream:
        return drive_from_dict(load_plain_json(stream.metadata.provenance["lens"])["drive"])


def _answer(record: Record, drive: Any) -> Answer:
    if record.judgement.position is None or record.judgement.truth is None:
        return Answer(None, None)
    return Answer(
        image_error_m(drive, record.judgement.position, truth=record.judgement.truth) * 1e6, record.judgement.error_dof
    )


def image_error_m(drive: Any, position: float, *, truth: float) -> float:
    """Return how far behind the sharp image of the target the sensor is, metres, with the lens at a position.

    ``truth`` is the position at which the target is in focus. It is nearer to the lens, or farther, if a stage moves.
    """
    both = np.array([position, truth])
    shift, in_focus, image = drive.shift(both), drive.object_distance(both), drive.image_distance(both)
    vergence = 1 / in_focus[0] + 1 / image[0]  # 1 / focal length, which may change with the position
    target = in_focus[1] + shift[1] - shift[0]
    return float(image[0] - 1 / (vergence - 1 / target))


def table(cameras: Mapping[str, Mapping[str, Mapping[str, Answer]]]) -> list[str]:
    """Return the lines of the table, over the recordings that have an answer with every camera.

    The last column is how often a method comes nearer to the focus than the best one of the first camera, by its
    median. Raises BadInput if no recording has an answer with every camera.
    """
    found = (set[str]().union(*answers.values()) for answers in cameras.values())
    shared = sorted(set[str].intersection(*found))
    if not shared:
        raise BadInput("no recording has an answer with every camera", allowed="more --members")
    members = [name.rpartition("-")[0] for name in shared]
    rows = []
    for camera, answers in cameras.items():
        for method, by_sequence in answers.items():
            held = [by_sequence.get(name, Answer(None, None)) for name in shared]
            off = np.array([np.inf if one.error_um is None else abs(one.error_um) for one in held])
            dof = np.array([np.inf if one.error_dof is None else abs(one.error_dof) for one in held])
            rows.append((camera, method, off, dof))
    first = next(iter(cameras))
    best = min((off for camera, _, off, _ in rows if camera == first), key=np.median)
    lines = [f"{len(shared)} recordings of {len(set(members))} members have an answer with every camera.", ""]
    columns = "within 10 µm", "within 30 µm", "median error, µm", "≤1 DoF of its own", f"nearer than {first}"
    lines += [f"| camera | method | {' | '.join(columns)} |", "|---" * (2 + len(columns)) + "|"]
    for camera, method, off, dof in sorted(rows, key=lambda row: (row[0] != first, row[0], np.median(row[2]))):
        low, high = _median_interval(off, members)
        cells = [_share(off <= 10, members), _share(off <= 30, members), f"{np.median(off):.1f} [{low:.1f}–{high:.1f}]"]
        cells += [_share(dof <= 1, members), "" if off is best else _share(off < best, members)]
        lines.append(f"| `{camera}` | `{method}` | {' | '.join(cells)} |")
    return lines


def _share(right: np.ndarray, members: Sequence[str]) -> str:
    mean, low, high = interval(right.astype(float), members)
    return f"{mean:.0%} [{100 * low:.0f}–{100 * high:.0f}]"


def _median_interval(values: np.ndarray, members: Sequence[str]) -> tuple[float, float]:
    """Return the ends of the 95 % interval of the median of values, (n,), if members, (n,), are drawn again."""
    _, index = np.unique(members, return_inverse=True)
    of_member = [values[index == number] for number in range(index.max() + 1)]
    drawn = np.random.default_rng(SEED).integers(0, len(of_member), (DRAWS, len(of_member)))
    medians = [np.median(np.concatenate([of_member[number] for number in draw])) for draw in drawn]
    low, high = np.quantile(medians, (0.025, 0.975), method="nearest")  # some may be infinite
    return float(low), float(high)


def main(given: Sequence[str] | None = None) -> int:
    """Compare the cameras, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder that keeps what is made")
    parser.add_argument("--camera", nargs="+", default=list(METHODS), choices=list(METHODS))
    parser.add_argument("--members", type=int, default=24, help="members of assorted_moving")
    parser.add_argument("--lux", type=float, help="light on the sensor (default: drawn for each member)")
    parser.add_argument("--seconds", type=float, default=1.0, help="time of the sweep, with --lux")
    parser.add_argument("--region", default="target", choices=["target", "inside"], help="where methods look")
    asked = parser.parse_args(given)
    more = {"lux": asked.lux, "seconds": asked.seconds, "region": asked.region}
    try:
        if asked.lux is None and asked.seconds != 1.0:
            raise BadInput(f"--seconds {asked.seconds:g} is given without --lux", hint="state --lux too")
        if not (asked.lux is None or 0.01 <= asked.lux <= 1500) or not 0.01 <= asked.seconds <= 100:
            raise BadInput(
                f"--lux is {asked.lux}, --seconds {asked.seconds:g}", allowed="0.01 to 1500 lux, 0.01 to 100 s"
            )
        check_writable(asked.out)
        answers = {name: run(name, folder=asked.out / name, members=asked.members, **more) for name in asked.camera}
        print("\n".join(table(answers)))
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
