"""Cameras as they are: every camera behind the same lens, in the same light, with its own pixels.

    python -m studies.ranking.native --out FOLDER [--split train] [--members N] [--lux L ...] [--seconds S]

Scenes, lights and motions of the lens are those of the first edition (``recipes/saf_bench.yaml``), with its eight
shortest travels. Each camera has its own pitch, fill factor and quantum efficiency, and sees the same field, 1.28 mm
wide and high, of the same members. A stack is rendered on the pixels of each camera, by a recipe whose spike sensor has
these pixels; the camera then records it. The target throws ``--lux`` of light of 555 nm on the sensor, in focus and at
gain 1: behind f/2, 1 lux is a dim room (30 lux), and 625 lux is daylight (20,000). So that a spike sensor with other
pixels fires as often, its threshold is as much higher or lower as its pixels collect more or less. ``--seconds`` is the
time of the sweep.

Levels of light share stacks. Recordings are removed once they are judged in the target's box and inside the target;
``FOLDER/CAMERA/SPLIT-L-lux-S-s-REGION.jsonl`` holds the records, and a second run goes on where the first one ended.
Conditions that are not the camera's own (``--dark``, ``--threshold``) are part of the name, after the split.
"""

import argparse
import math
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import read_records, write_records
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.camera import Sensor, get_sensor
from saf_gen.camera.exposure import electrons_per_irradiance, firing_rate
from saf_gen.camera.frames import FrameSensor
from saf_gen.camera.photons import SpadSensor
from saf_gen.core.files import check_writable, unwritable, write_text
from saf_gen.errors import BadInput
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics.actuators import get_actuator
from saf_gen.stack.recapture import CAMERAS, STACKS, Recapture
from saf_gen.stream.manifest import read_manifest

EDITION = Path(__file__).resolve().parents[2] / "recipes" / "saf_bench.yaml"
FIELD_M = 1.28e-3  # side of the square that all cameras see: 64 pixels of a spike camera
BASE = "vidar_128x128"  # the spike camera, in whose rate the light is set
EVENTS = "davis346"
PIXELS = "_pixels"  # end of the name of a spike sensor with the pixels of a camera
LUMENS_PER_W = 683.0  # at 555 nm
LEVELS_LUX = (1.0, 5.0, 25.0, 125.0, 625.0)
DIM_SHOT_HZ = ((5.0, 10.0), (25.0, 5.0))  # events of noise per pixel and second up to so many lux, from DND21 and v2e
LEAST_THRESHOLD, MOST_THRESHOLD = 0.14, 0.23  # of davis346, by its data sheet
BIN = 4  # pixels of imx273 in a row, and in a column, that make one
ROW_S, PAUSE_ROWS = 396 / 74.25e6, 42  # of imx273 at 12 bits: seconds per row, and rows between two frames
LOG_HZ = 2_000  # readouts per second of a sensor whose spikes nobody looks at: they log the lens, and small files do
SAMPLES, FEWEST_SAMPLES = 96, 64  # per pixel of the spike camera, and of any camera
POSITIONS = 80  # steps of the lens between its ends for the spike camera; finer for finer pixels, as the depth of focus
REGIONS = ("target", "inside")
LOOP, BUDGET_S = "loop", 0.3  # a voice coil inside the target: name of its files, and the time until the lens is judged
METHODS: Mapping[str, Sequence[str]] = {
    BASE: ["fine_structure+bell_vote", "octave_structure+peak_fit", "fine_structure+argmax_light"],
    "qvga_spad": ["fine_structure+bell_vote", "gradient_code_n+egs_code", "octave_structure+argmax:window=300"],
    "imx273": ["fine_structure+bell_vote", "mfdct_lee_n+argmax:window=2", "tenengrad_n+argmax:window=2"],
    "davis346": ["er_count+event_reversal", "er_count+elp_events", "gradient_code_n+egs_code"],
}
"""The best three pairs of measure and search of each camera on its training members, best first."""
GUESS = "sd+middle"  # what every camera has without looking


def rate_at(lux: float, dark: str = "") -> float:
    """Return the mean rate of the spike camera, with its dark current, at a light of ``lux`` on its pixels."""
    sensor = get_sensor(BASE)
    charge = lux / LUMENS_PER_W * electrons_per_irradiance(sensor)
    return float(firing_rate(np.array(charge + (0.0 if dark == "none" else sensor.mean_dark_e)), sensor))


def recipe(
    pixels: Sensor, *, split: str, members: int, lux: float, seconds: float = 1.0, dark: str = ""
) -> dict[str, Any]:
    """Return the recipe of a camera with these pixels; members, motions and light are those of all cameras."""
    finer = get_sensor(BASE).pitch_m / pixels.pitch_m
    edition = yaml.safe_load(EDITION.read_text(encoding="utf-8"))
    of_split = {"scenes": edition["splits"][split]["scenes"], "lights": list(edition["lights"])}
    return {
        "name": "native",
        "seed": edition["seed"],
        "camera": {
            "sensor": "pixels.yaml",
            "frames": round(pixels.readout_hz * seconds),
            "exposure": {"mean_rate": rate_at(lux, dark)},
        },
        "focus": {"positions": round(POSITIONS * finer) + 1, "motion": edition["focus"]["motion"]},
        "render": {"samples": max(round(SAMPLES / finer**2), FEWEST_SAMPLES)},
        "lights": edition["lights"],
        "scene_params": edition["splits"]["test_moving"]["scene_params"],
        "splits": {split: {**of_split, "members": members, "lights_each": 1}},
    }


def pixels_of(camera: Any, dark: str = "") -> Sensor:
    """Return the spike sensor with the pixels of a camera, over the field, that fires as often in the same light.

    Its dark current may be ``even`` over the pixels, or ``none``.
    """
    base = get_sensor(BASE)
    if dark:
        base = base.with_noise(dark=False) if dark == "none" else replace(base, dark_log_sd=0.0, dark_hot_fraction=0.0)
    side = round(FIELD_M / camera.pitch_m)
    area = camera.pitch_m**2 * camera.fill_factor * camera.quantum_efficiency
    collected = area / (base.pitch_m**2 * base.fill_factor * base.quantum_efficiency)
    hz = LOG_HZ if isinstance(camera, SpadSensor | FrameSensor) else base.readout_hz
    return replace(
        base,
        name=f"{camera.name}{PIXELS}",
        rows=side,
        columns=side,
        pitch_m=camera.pitch_m,
        fill_factor=camera.fill_factor,
        quantum_efficiency=camera.quantum_efficiency,
        readout_hz=hz,
        threshold_e=base.threshold_e * collected * base.readout_hz / hz,
    )


def camera_of(name: str, lux: float, threshold: float | None = None) -> Any:
    """Return a camera by name; a frame camera reads the rows of the field, which sets its rate.

    The noise of an event camera is that which was published for so much light; ``threshold`` sets its biases.
    """
    if name == BASE:
        return get_sensor(name)
    if name == EVENTS:
        sensor = get_sensor(name, kind="events")
        return biased(sensor, threshold=threshold or sensor.threshold_on, lux=lux)
    if name == "qvga_spad":
        return get_sensor(name, kind="photons")
    chip = get_sensor(name, kind="frames")
    rows = round(FIELD_M / chip.pitch_m)
    hz = round(1 / ((rows + PAUSE_ROWS) * ROW_S), 1)
    return get_sensor(
        name,
        kind="frames",
        rows=rows // BIN,
        columns=rows // BIN,
        pitch_m=BIN * chip.pitch_m,
        readout_hz=hz,
        exposure_s=min(chip.exposure_s, 1 / hz),
        full_well_e=BIN**2 * chip.full_well_e,
        read_noise_e=BIN * chip.read_noise_e,
        bits=chip.bits + 4,
        black_level_dn=BIN**2 * chip.black_level_dn,
        dark_e_per_s=BIN**2 * chip.dark_e_per_s,
        response_rms=chip.response_rms / BIN,
    )


def biased(sensor: Any, *, threshold: float, lux: float) -> Any:
    """Return an event sensor whose biases set this threshold, with the noise of so much light.

    Mismatch stays as it is, because transistors differ by a voltage. The stored level drifts as fast as before, so
    that leaks grow as the threshold falls. Noise of standard deviation s in a band of B hertz crosses a threshold c
    at a rate of B·exp(−c²/2s²) (Rice 1945, doi:10.1002/j.1538-7305.1945.tb00453.x); B is that of the photoreceptor,
    and s follows from the rate at the nominal threshold.
    """
    noise = next((hz for most, hz in DIM_SHOT_HZ if lux <= most), sensor.shot_hz)
    if threshold == sensor.threshold_on:
        return sensor if noise == sensor.shot_hz else get_sensor(sensor.name, kind="events", shot_hz=noise)
    pixel = get_sensor(BASE)
    area = sensor.pitch_m**2 * sensor.fill_factor * sensor.quantum_efficiency
    of_pixel = pixel.pitch_m**2 * pixel.fill_factor * pixel.quantum_efficiency
    per_s = lux / LUMENS_PER_W * electrons_per_irradiance(pixel) * pixel.readout_hz * area / of_pixel
    band = 1 / (2 * math.pi * (sensor.receptor_e / per_s + sensor.receptor_s))
    ratio = (threshold / sensor.threshold_on) ** 2
    return get_sensor(
        sensor.name,
        kind="events",
        threshold_on=threshold,
        threshold_off=threshold,
        leak_hz=sensor.leak_hz * sensor.threshold_on / threshold,
        shot_hz=band * (min(noise, band) / band) ** ratio,
    )


def run(
    name: str,
    *,
    folder: Path,
    split: str,
    members: int,
    lux: float,
    seconds: float = 1.0,
    methods: Sequence[str] = (),
    loop: bool = False,
    threshold: float | None = None,
    dark: str = "",
) -> list[Path]:
    """Render, record and judge one camera in ``folder``; return the files of its records, one for each region.

    With ``loop``, methods move the lens of the running camera instead, and look inside the target.

    Raises BadInput if a sequence fails, or the folder cannot be written to.
    """
    camera = camera_of(name, lux, threshold)
    condition = (f"_dark_{dark}" if dark else "") + ("" if threshold is None else f"_threshold_{threshold:g}")
    level = f"{split}{condition}-{lux:g}-lux-{seconds:g}-s"
    asked = list(dict.fromkeys([*(methods or METHODS[name]), GUESS]))
    kept = {region: folder / f"{level}-{region}.jsonl" for region in ((LOOP,) if loop else REGIONS)}
    if all(_holds(path, asked, members) for path in kept.values()):
        return list(kept.values())
    dataset = folder / level
    try:
        for part in (STACKS, "preview"):  # all levels share them
            (folder / part).mkdir(parents=True, exist_ok=True)
            dataset.mkdir(exist_ok=True)
            if not (dataset / part).is_symlink():
                (dataset / part).symlink_to(Path("..") / part, target_is_directory=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    pixels = pixels_of(camera, dark)
    write_text(folder / "pixels.yaml", yaml.safe_dump({"kind": "spikes", **pixels.as_dict()}, sort_keys=False))
    made_by = recipe(pixels, split=split, members=members, lux=lux, seconds=seconds, dark=dark)
    write_text(folder / "recipe.yaml", yaml.safe_dump(made_by, sort_keys=False))
    made = generate(resolve_recipe(folder / "recipe.yaml"), dataset, tell=print)
    _refuse_failures(made.failed)
    judged = dataset
    if name != BASE:
        given, judged, manifest = name, dataset / CAMERAS / name, read_manifest(dataset)
        if camera != get_sensor(name, kind=camera.kind):
            given = str(folder / "camera.yaml")
            write_text(Path(given), yaml.safe_dump({"kind": camera.kind, **camera.as_dict()}, sort_keys=False))
        other = Recapture.by(given)
        _refuse_failures(other.record_all(dataset, manifest.sequences, target=judged, tell=print).failed)
        other.finish(dataset, manifest, target=judged)
    for region, path in kept.items():
        where = {"region": "inside", "protocol": protocol()} if region == LOOP else {"region": region}
        result = evaluate(judged, methods=asked, split=split, draw=False, **where)
        _refuse_failures({failure.sequence: failure.problem for failure in result.failures})
        write_records(path, result.records)
    shutil.rmtree(dataset)  # the stacks are elsewhere
    return list(kept.values())


def protocol() -> ClosedLoopProtocol:
    """Return the terms of the closed loop: a voice coil as its data sheet has it, and half the time for a sweep."""
    return ClosedLoopProtocol(get_actuator("voice_coil"), budget_s=BUDGET_S)


def _holds(path: Path, methods: Sequence[str], members: int) -> bool:
    """Return whether a file has the records of these methods on so many members."""
    records = read_records(path) if path.exists() else []
    return {record.who.method for record in records} == set(methods) and len(records) == len(methods) * members


def _refuse_failures(failed: Mapping[str, object]) -> None:
    """Raise BadInput if anything failed, because a table without it would compare other recordings."""
    if failed:
        raise BadInput("; ".join(f"{what}: {problem}" for what, problem in failed.items()))


def main(given: Sequence[str] | None = None) -> int:
    """Record and judge the cameras, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder that keeps what is made")
    parser.add_argument("--camera", nargs="+", default=list(METHODS), choices=list(METHODS))
    parser.add_argument("--split", default="test", choices=["train", "test"], help="members of the first edition")
    parser.add_argument("--members", type=int, default=50, help="members of the split, each with one light")
    parser.add_argument("--lux", type=float, nargs="+", default=list(LEVELS_LUX), help="light on the sensor")
    parser.add_argument("--seconds", type=float, default=1.0, help="time of the sweep")
    parser.add_argument("--loop", action="store_true", help="move the lens of a running camera, for 0.3 s")
    parser.add_argument("--threshold", type=float, help="of events, 0.14 to 0.23 (default: 0.2)")
    parser.add_argument("--dark", default="", choices=["even", "none"], help="dark current of the spike sensor")
    parser.add_argument("--method", nargs="+", default=[], help="methods in place of those of each camera")
    asked = parser.parse_args(given)
    try:
        wrong = [lux for lux in asked.lux if not 0.01 <= lux <= 1500]
        if wrong or not 0.01 <= asked.seconds <= 100:
            raise BadInput(
                f"--lux is {asked.lux}, --seconds {asked.seconds:g}", allowed="0.01 to 1500 lux, 0.01 to 100 s"
            )
        if asked.threshold is not None and not LEAST_THRESHOLD <= asked.threshold <= MOST_THRESHOLD:
            raise BadInput(f"--threshold is {asked.threshold:g}", allowed="0.14 to 0.23, by the data sheet")
        for option, of in (("dark", BASE), ("threshold", EVENTS)):
            if getattr(asked, option) and asked.camera != [of]:
                raise BadInput(f"--{option} is given for {', '.join(asked.camera)}", allowed=f"--camera {of}")
        check_writable(asked.out)
        more = {"split": asked.split, "members": asked.members, "seconds": asked.seconds, "methods": asked.method}
        more |= {"loop": asked.loop, "threshold": asked.threshold, "dark": asked.dark}
        for name in asked.camera:
            for lux in asked.lux:
                for path in run(name, folder=asked.out / name, lux=lux, **more):
                    print(path)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
