"""Evaluations made by hand, for tests of figures and of the report page."""

import itertools

import numpy as np
from handmade_records import failed, record

from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.plugin_description import describe_plugins
from saf_gen.benchmark.results import Evaluation, FocusCurve, LensPath, SequenceFailure, SweepSummary
from saf_gen.benchmark.sequence_evaluation import assess_curves
from saf_gen.benchmark.thumbnails import Thumbnails
from saf_gen.leaderboard import Leaderboard
from saf_gen.leaderboard.report import write_evaluation
from saf_gen.leaderboard.report.pictures import Delivered
from saf_gen.stream.pictures.image_strip import lay_out_pictures

LENS = np.linspace(0, 1, 800, dtype=np.float32)
CENTRES = np.arange(0, 800, 50) + 24.5
LIGHTS = {"constant": 1.0, "ramp": 4.0, "steps": 2.5}


def board_of(records, *, failures=(), **more):
    """Return the leaderboard of these records."""
    return Leaderboard.of(Evaluation(tuple(records), failures=tuple(failures), **{"sweeps": (), **more}))


def write_board(folder, records, **more):
    """Write the evaluation of these records into a folder, and return the paths of its files."""
    write_evaluation(folder, board_of(records, **more), title="title")
    return sorted(folder.iterdir())


def make_sweep(
    light="constant", *, scene="camel", split="test", lens=LENS, measures=("sd", "sd_code", "er_count"), **more
):
    bump = np.exp(-(((CENTRES - 300) / 90) ** 2))
    scores = {"sd": bump, "sd_code": 1e5 * bump, "er_count": np.linspace(1, 2, CENTRES.size)}
    known = {"truth": 0.375, "depth_of_focus": (0.33, 0.42), "truth_frame": 300.0}
    return SweepSummary(
        sequence=f"{scene}-{light}",
        split=split,
        scene=scene,
        light=light,
        focus_position=lens,
        frames=CENTRES,
        rate=np.full(CENTRES.size, 0.2),
        curves=tuple(FocusCurve(m, CENTRES, scores[m], float(CENTRES[scores[m].argmax()])) for m in measures),
        **{**known, **more},
    )


def make_thumbnails(count=16, *, rows=20, columns=32):
    """Return pictures whose brightness encodes their number."""
    grey = np.linspace(1, 60, count).astype(np.uint32)
    images = np.broadcast_to(grey[:, None, None], (count, rows, columns)).copy()
    frames = (np.arange(count) + 0.5) * 800 / count - 0.5
    spikes = np.tile(np.arange(rows * columns).reshape(rows, columns) % 2, (count, 1, 1)).astype(np.uint8)
    return Thumbnails(images, images.astype(np.float32), spikes, frames, 800 // count, 1, (0.25, 0.125, 0.75, 0.875))


def make_delivered():
    """Return pictures at the answers of two methods."""
    greys = [np.full((12, 12), grey, np.uint8) for grey in (200, 90)]
    strip = lay_out_pictures(greys, count=2).encode("PNG")
    return Delivered("camel-constant", strip, (("sd+argmax", 0.125), ("er_count+argmax", -4.0)), 8)


def make_lens_path(method, light="constant", *, scene="camel", problem=""):
    seconds = np.linspace(0.0, 0.04, 50)
    return LensPath(
        method=method, sequence=f"{scene}-{light}", split="test", scene=scene, light=light, seconds=seconds,
        position=np.linspace(0.1, 0.4, 50), truth=np.full(50, 0.375), depth_of_focus=0.09, problem=problem,
    )  # fmt: skip


def make_records(*, seed=5):
    """Return records of four methods on three scenes in two splits under three lights, one of them repeated."""
    random = np.random.default_rng(seed)
    methods = ("sd+argmax", "sd+egs_code", "er_count+argmax", "er_count+egs_code")
    records = []
    for scene, (light, ratio), repeat in itertools.product(("camel", "fan", "usaf"), LIGHTS.items(), (0, 1)):
        if repeat and light != "ramp":
            continue
        sequence = f"{scene}-{light}" + (f"-{repeat}" if repeat else "")
        fields = {
            "scene": scene,
            "light": light,
            "split": "train" if scene == "fan" else "test",
            "light_ratio": ratio,
            "mean_rate": float(random.uniform(0.01, 0.5)),
            "scene_motion": "dynamic" if repeat else "static",
        }
        for method in methods:
            width = 0.6 if method.startswith("sd") else 4.0
            if random.random() < 0.1:
                status = "failed" if random.random() < 0.5 else "abstained"
                records.append(failed(method, sequence, status, **fields, note="no <b>peak</b>"))
                continue
            error = float(random.normal(0, width))
            trace = tuple(random.uniform(0, 799, 6)) if "egs" in method else (400.0,)
            more = {
                "seconds": float(random.uniform(0, 1)),
                "windows": int(random.integers(1, 99)),
                "time_to_focus_s": 0.4,
            }
            more |= {"frames_seen": int(random.integers(100, 800)), "trace": trace}
            records.append(record(method, sequence, error, **fields, **more))
    return records


def make_evaluation():
    """Return a complete evaluation: pictures of one sweep, a failure, scenes with and without curves."""
    sweeps = (
        make_sweep("constant", thumbnails=make_thumbnails()),
        make_sweep("ramp"),
        make_sweep("steps", scene="fan", split="train"),
    )
    failures = (SequenceFailure("bad", "truncated"),)
    plugins = describe_plugins(map(parse_method, ("sd+argmax", "er_count+egs_code")))
    return Evaluation(tuple(make_records()), sweeps, failures, plugins=plugins, curves=tuple(assess_curves(sweeps)))
