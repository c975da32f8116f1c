"""Pinned numbers of both tracks: changes that need a new version in saf_gen/benchmark/versions.py are noticed."""

import hashlib
import json
from dataclasses import replace
from numbers import Number
from pathlib import Path

import numpy as np
import pytest
from handmade_records import BLANK

from saf_gen import write_stream
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.gym.episode import Episode
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.records import Record, Who, record_to_json
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.camera import get_sensor
from saf_gen.core.seeds import make_generator
from saf_gen.optics import ImageDistanceDrive
from saf_gen.optics.actuators import get_actuator
from saf_gen.stack.capture import Capture
from saf_gen.stack.focal_stack import FocalStack, StackSpec
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.metadata import Truth

RECORDED = "431de541ffdf171336f173508f6e34e6e4ab812f5922e25cbe32f4ec7c3dbf0c"
CLOSED_LOOP = "6bd8d455943102f5274d6071b020337e972f0d5e5f0ba6d2969636df4fed97b4"
OBSERVED = "9cb5c9ecb1a99a538b511e2a5281280b7105914663e1c193a2b6be00dd4687ad"
FRAMES, ROWS, COLUMNS, PEAK = 800, 24, 32, 300
BOARD = np.where(np.add.outer(np.arange(ROWS) // 4, np.arange(COLUMNS) // 4) % 2, 1, -1)
RECORDED_METHODS = [
    "sd+argmax:window=50,refine=parabola",
    "gradient_code_n+egs_code",
    "mfdct_lee_n+sgfs_code",
    "sd_code+sgfs_causal",
    "tenengrad_n_tfi+egs",
    "sd_debiased+argmax:window=40",
    "cen+argmax@frame",
    "structure_calibrated+photon_aware",
]
CLOSED_LOOP_METHODS = [
    "sd+golden_section",
    "gradient_code_n+coarse_to_fine",
    "sd+hill_climb",
    "tenengrad_n_tfi+argmax:window=80",
    "sd_debiased+sgfs_causal",
    "sd_calibrated+photon_aware",
]


def digest(values: object) -> str:
    """Return the SHA-256 of numbers, rounded to 12 digits because machines differ in the last ones."""

    def rounded(value: object) -> object:
        if isinstance(value, dict):
            return {key: rounded(one) for key, one in value.items()}
        if isinstance(value, list | tuple):
            return [rounded(one) for one in value]
        return f"{round(value, 12):.12g}" if isinstance(value, Number) else value

    return hashlib.sha256(json.dumps(rounded(values)).encode()).hexdigest()


def numbers(records: list[Record]) -> list[dict[str, object]]:
    """Return the fields of records that depend only on the evaluator, not on times, code, versions or the file."""
    left_out = {*"seconds note data code machine limits failed_check parameters rig stratum".split()}
    left_out |= {"format", "grain_rms", "grain_of_curve", "sensor", "benchmark", "operations", "reference_rate"}
    return [{key: x for key, x in record_to_json(record).items() if key not in left_out} for record in records]


def write_recording(path: Path) -> None:
    """Write a chequered board, sharp at frame PEAK, in growing light; in integers, so the same on every machine."""
    frame = np.arange(FRAMES)
    contrast = 12 + 230 * np.maximum(0, 150 - abs(frame - PEAK)) // 150  # in 256
    light = 8000 + 20 * frame  # in 65536 spikes per readout
    rate = (light[:, None, None] * (256 + contrast[:, None, None] * BOARD)) // 256
    phase = make_generator("test_versions").integers(0, 65_536, (ROWS, COLUMNS))
    spikes = np.diff((phase + np.cumsum(rate, axis=0)) // 65_536, axis=0, prepend=0).clip(0, 1)
    target = np.zeros((ROWS, COLUMNS), bool)
    target[3:20, 5:30] = True
    position = PEAK / FRAMES
    truth = Truth(position=position, depth_of_focus=(position - 0.05, position + 0.05), frame=PEAK, target=target)
    lens = (frame / FRAMES).astype(np.float32)
    gain = (light / 8000).astype(np.float32)[:, None]
    write_stream(path, spikes.astype(np.uint8), focus_position=lens, truth=truth, gain=gain, light_names=("lamp",))


def make_capture() -> Capture:
    """Return a capture of the board, sharp at 0.375 of the travel, with less contrast on both sides."""
    sensor = get_sensor("vidar_400x250", rows=ROWS, columns=COLUMNS)
    drive = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
    contrast = np.maximum(8, 240 - 40 * abs(np.arange(33) - 12))[:, None, None] / 256
    radiance = (1 + contrast * BOARD)[None].astype(np.float32)
    spec = StackSpec(
        scene="board", scene_digest="", groups=("lamp",), drive=drive, rows=ROWS, columns=COLUMNS,
        pitch_m=sensor.pitch_m, positions=33, samples=1, max_depth=1,
    )  # fmt: skip
    whole = np.ones((ROWS, COLUMNS), bool)
    stack = FocalStack(spec, radiance, np.float32(drive.focus_depth(0.375)) * whole, whole, "none")
    gain = np.linspace(0.75, 1.5, 4000, dtype=np.float32)[:, None]
    truth = Truth(position=0.375, depth_of_focus=(0.33, 0.42))
    return Capture(PlaneSource.from_stack(stack), sensor, gain, 4.0, 5, 1, truth, len(gain))


def make_sequence() -> ClosedLoopSequence:
    """Return a sequence of that capture with a box where methods look."""
    capture, box = make_capture(), (slice(4, 20), slice(2, 28))
    task = SequenceTask("a", "test", "board", "ramp", Path("a.h5"), None)
    light = capture.open_light(capture.rows_for(box))
    return ClosedLoopSequence(task, capture, box, "target", light, "")


@pytest.mark.slow
def test_the_numbers_of_the_recorded_track_are_those_of_its_versions(tmp_path):
    """If it fails, raise COUNTS_VERSION or JUDGEMENT_VERSION in saf_gen/benchmark/versions.py, pin the new digest, and
    say in the commit what moved. A change of a measure or search needs no new version, because each record contains
    their digests.
    """
    write_recording(tmp_path / "a.h5")
    (tmp_path / "p.jsonl").write_text(
        '{"method": "early", "sequence": "a", "frame": 250.5, "frames_seen": 400}\n'
        '{"method": "none", "sequence": "a", "frame": null}\n'
    )
    found = evaluate(tmp_path / "a.h5", methods=RECORDED_METHODS, region="both", predictions=tmp_path / "p.jsonl")
    assert digest(numbers(found.records)) == RECORDED


def test_the_numbers_of_the_closed_loop_are_those_of_its_versions():
    """If it fails, raise CAPTURE_VERSION, or the version of what moved, in saf_gen/benchmark/versions.py, pin the new
    digest, and say in the commit what moved. A new ``MODEL`` of spikes moves it as well.
    """
    sequence = make_sequence()
    records = []
    for drive in ("voice_coil", "liquid_lens"):
        protocol = ClosedLoopProtocol(get_actuator(drive))
        for method in map(parse_method, CLOSED_LOOP_METHODS):
            run = run_closed_loop(sequence.make_captured(), method, protocol=protocol)
            what = replace(BLANK.what, track="closed_loop")
            records.append(sequence.make_record(run, who=Who(method.name, "", "target"), what=what))
    assert digest(numbers(records)) == CLOSED_LOOP


def test_what_a_policy_observes_and_earns_is_that_of_its_version():
    """If it fails, raise CAPTURE_VERSION, pin the new digest, and say in the commit what moved."""
    protocol = ClosedLoopProtocol(get_actuator("voice_coil"))
    episode = Episode(make_sequence(), protocol, control_s=0.005, pixels=6)
    steps = [(episode.observe(), 0.0), episode.move(0.1), episode.move(0.6), episode.stop(0.375)]
    seen = [[*(value.ravel().tolist() for value in view.values()), reward] for view, reward in steps]
    assert digest(seen) == OBSERVED
