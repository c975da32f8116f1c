import json
import shutil
from fractions import Fraction

import h5py
import numpy as np
import pytest
from handmade_records import change
from own_plugins import PARTS
from planted_sweeps import SHAPE, list_streams, make_spikes, make_truth, write_sweep
from refusals import assert_says, refusal

from saf_gen.benchmark.admission import read_methods
from saf_gen.benchmark.evaluate import evaluate, score_blocks
from saf_gen.benchmark.method_spec import DEFAULT_RECORDED_METHODS, parse_method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.leaderboard import rank_methods
from saf_gen.optics.actuators import get_actuator
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.parts import Answer, View
from saf_gen.plugins.measures import get_measure
from saf_gen.plugins.motions import lens_positions
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream
from saf_gen.stream.time_blocks import BLOCK_MEMORY

PEAK = 300.0
BRIGHTENING = np.linspace(0.4, 2.0, SHAPE[0])


@pytest.fixture(scope="module")
def stream_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("one") / "sweep.h5"
    write_sweep(path, PEAK)
    return path


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder, sequences = tmp_path_factory.mktemp("data"), []
    for split, scene, light, gain in [
        ("train", "board", "constant", 1.0),
        ("test", "board2", "constant", 1.0),
        ("test", "board2", "ramp", BRIGHTENING),
    ]:
        name = f"{scene}-{light}-0"
        write_sweep(folder / split / f"{name}.h5", PEAK, gain=gain)
        sequences.append({"id": name, "split": split, "scene": scene, "light": light})
    return list_streams(folder, *sequences)


def one(path, method, **options):
    (record,) = evaluate(path, methods=[method], **options).records
    return record


def test_a_method_is_a_measure_a_search_and_their_options():
    method = parse_method("sd_code+argmax:window=50,refine=parabola")
    assert (method.measure_name, method.search_name) == ("sd_code", "argmax")
    assert (method.search.window, method.search.refine) == (50, "parabola")
    assert method.name == "sd_code+argmax:window=50,refine=parabola"


def test_the_code_digest_follows_options_and_parts_and_nothing_else():
    assert parse_method("sd+argmax").code == parse_method("sd+argmax").code
    codes = {parse_method(spec).code for spec in ("sd+argmax", "sd+argmax:window=50", "sd_code+argmax", "sd+egs_code")}
    assert len(codes) == 4


PAIR = "MEASURE+SEARCH | saf-gen methods list"


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        *((spec, PAIR) for spec in ("sd_code", "+argmax", "a+b+c", "")),
        ("sd_cod+argmax", "focus measure 'sd_cod' | mean 'sd_code'"),
        ("sd_code+egs_cod", "search 'egs_cod' | mean 'egs_code'"),
        ("sd_code+argmax:windw=5", "'windw' | mean 'window'"),
        ("sd_code+argmax:window", "option 'window'"),
        ("sd_code+argmax:window=many", "'many'"),
        ("sd+argmax@fram", "region 'fram' | mean 'frame'"),
        ("argmax:window=50+sd", "names the search first | mean 'sd+argmax:window=50'"),
        ("baseline", "mean 'baselines'"),
    ],
)
def test_a_name_of_no_method_is_refused_with_the_nearest_or_an_example(spec, words):
    assert_says(refusal(parse_method, spec), f"{spec} | {words}")


def test_a_file_and_a_function_in_it_are_suggested(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.py").write_text("import os\n\ndef lap2(counts):\n    return 1.0\n")
    assert refusal(parse_method, "my:lap2+argmax").nearest == "my.py:lap2+argmax"
    error = refusal(parse_method, "my.py:lap+argmax")
    assert (error.problem, error.allowed, error.nearest) == ("my.py has no 'lap'", "lap2", "lap2")


@pytest.mark.parametrize("given", ["list", "file"])
def test_baselines_stand_for_the_methods_of_the_track_beside_others(stream_file, tmp_path, monkeypatch, given):
    monkeypatch.setattr("saf_gen.benchmark.evaluate.DEFAULT_RECORDED_METHODS", ("sd+argmax", "cen+argmax"))
    methods = ["sd_code+argmax", "baselines", "sd+argmax"]
    if given == "file":
        (tmp_path / "methods.txt").write_text("\n".join(methods))
        methods = read_methods(tmp_path / "methods.txt")
    ran = [record.who.method for record in evaluate(stream_file, methods=methods).records]
    assert ran == ["sd_code+argmax", "sd+argmax", "cen+argmax"]


def test_argmax_finds_the_planted_focus_within_a_block(stream_file):
    record = one(stream_file, "sd+argmax:window=50")
    assert record.judgement.status == "answered"
    assert abs(record.judgement.frame - PEAK) <= 25.5
    assert record.judgement.error_frames == pytest.approx(record.judgement.frame - PEAK)
    assert record.judgement.error == pytest.approx(record.judgement.error_frames / (SHAPE[0] - 1), abs=1e-6)
    assert record.judgement.error_dof == pytest.approx(record.judgement.error / 0.1)
    assert record.success() is True
    assert (record.judgement.windows, record.who.region) == (16, "frame")
    assert (record.judgement.frames_seen, record.what.frames) == (800, 800)
    assert record.judgement.lens_travel == pytest.approx(1 + (1 - record.judgement.position))
    assert (record.what.sequence, record.what.scene, record.what.split, record.what.light) == (
        "sweep",
        "sweep",
        None,
        None,
    )
    with open_stream(stream_file) as stream:
        assert record.what.data == stream.content_sha256


def moving(path, lens, *, dof=0.1, log=None):
    """Write a stream whose contrast follows the lens, sharp at 0.4 of the travel, and its truth; maybe another log."""
    contrast = 0.05 + 0.9 * np.exp(-(((lens - 0.4) / 0.11) ** 2))
    board = np.where(np.add.outer(np.arange(48) // 4, np.arange(64) // 4) % 2, 1.0, -1.0)
    rate = 0.25 * (1 + contrast[:, None, None] * board)
    phase = make_generator("moving").random((48, 64))
    frames = np.diff(np.floor(phase + np.cumsum(rate, axis=0)), axis=0, prepend=0.0).astype(np.uint8)
    crossings = focus_crossings(lens, 0.4)
    frame = crossings[0] if crossings.size else float("nan")
    truth = {"position": 0.4, "depth_of_focus": (0.4 - dof / 2, 0.4 + dof / 2), "frame": frame}
    truth |= {} if log is None else {"lens": lens}
    write_stream(path, frames, focus_position=lens if log is None else log, truth=truth)


MOVED = {
    "there and back": ({"kind": "sweep_and_return", "dwell_s": 0.005}, True),
    "hand": ({"kind": "hand", "reversals": True, "bandwidth_hz": 150.0, "irregularity": 1.0, "seed": 1}, True),
    "hold, sharp": ({"kind": "hold", "position": 0.42}, True),
    "hold, blurred": ({"kind": "hold", "position": 0.8}, False),
}


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "in_reach"), MOVED.values(), ids=MOVED)
def test_no_method_breaks_on_a_lens_that_comes_back_or_rests(tmp_path, motion, in_reach):
    """All default methods answer, argmax correctly; errors refer to the position and to the nearest focus crossing.

    photon_aware, peak_fit and bell_vote may abstain if the lens is at rest: the curve then has no peak.
    """
    lens = lens_positions(motion, 800, readout_hz=20_000).astype(np.float32)
    moving(tmp_path / "s.h5", lens)
    (*records,) = evaluate(tmp_path / "s.h5", methods=[*DEFAULT_RECORDED_METHODS, "sd+argmax:window=20"]).records
    crossings = focus_crossings(lens, 0.4)
    for record in records:
        if (
            record.who.method.endswith(("photon_aware", "peak_fit", "bell_vote"))
            and motion["kind"] == "hold"
            and record.judgement.frame is None
        ):
            continue
        assert record.judgement.status == "answered"
        assert record.judgement.error == pytest.approx(
            np.interp(record.judgement.frame, np.arange(800), lens) - 0.4, abs=1e-6
        )
        assert record.judgement.error_dof == pytest.approx(record.judgement.error / 0.1)
        nearest = crossings[np.abs(crossings - record.judgement.frame).argmin()] if crossings.size else None
        assert record.judgement.truth_frame == pytest.approx(nearest)
        assert record.judgement.error_frames == (
            None if nearest is None else pytest.approx(record.judgement.frame - nearest)
        )
    assert records[-1].success() is in_reach


@pytest.mark.slow
def test_an_answer_is_judged_by_where_the_lens_was_and_not_by_its_log(tmp_path):
    """The log leads by 0.1, a depth of focus: all that depends on the lens is that of a stream without the log."""
    lens = np.linspace(0, 0.9, 800, dtype=np.float32)
    moving(tmp_path / "plain.h5", lens)
    moving(tmp_path / "driven.h5", lens, log=lens + np.float32(0.1))
    plain, driven = (one(tmp_path / f"{name}.h5", "sd+argmax:window=20") for name in ("plain", "driven"))
    same = {"data": "", "seconds": 0.0, "reference_rate": None, "sequence": "", "scene": ""}
    assert change(driven, **same) == change(plain, **same)
    assert abs(driven.judgement.error) < 0.05


@pytest.mark.slow
def test_a_stream_without_truth_or_without_a_lens_record_is_searched_with_null_errors(tmp_path):
    write_sweep(tmp_path / "blind.h5", PEAK, known=False)
    record = one(tmp_path / "blind.h5", "sd+argmax:window=50")
    assert abs(record.judgement.frame - PEAK) <= 25.5
    assert record.judgement.position == pytest.approx(record.judgement.frame / (SHAPE[0] - 1))
    assert (
        record.judgement.truth,
        record.judgement.error,
        record.judgement.error_frames,
        record.judgement.error_dof,
    ) == (None,) * 4
    assert record.success() is None
    write_stream(tmp_path / "bare.h5", make_spikes(PEAK))
    bare = one(tmp_path / "bare.h5", "sd+argmax:window=50")
    assert bare.judgement.frame == record.judgement.frame
    assert (bare.judgement.position, bare.judgement.error, bare.judgement.lens_travel) == (None, None, None)


@pytest.fixture(scope="module")
def two_depths(tmp_path_factory):
    """A sweep whose target, in the right half, is in focus at frame 600, and the left half at frame 300."""
    frames = make_spikes(PEAK)
    frames[:, :, 32:] = make_spikes(600.0)[:, :, 32:]
    target = np.zeros(SHAPE[1:], dtype=bool)
    target[8:40, 36:60] = True
    lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
    path = tmp_path_factory.mktemp("depths") / "two.h5"
    write_stream(path, frames, focus_position=lens, truth=make_truth(600.0, target=target))
    return path


@pytest.mark.slow
def test_both_regions_are_two_methods_each(two_depths):
    alone = {region: one(two_depths, "sd+argmax:window=50", region=region) for region in ("target", "frame")}
    assert abs(alone["target"].judgement.frame - 600) <= 25.5  # it sees only the box round the target
    steps, methods = [], ["sd+argmax:window=50", "cen+argmax"]
    both = evaluate(two_depths, methods=methods, region="both", progress=lambda *step: steps.append(step))
    assert sorted({(done, total) for done, total, _ in steps}) == [(n, 4) for n in (1, 2, 3, 4)]
    names = ["sd+argmax:window=50", "cen+argmax", "sd+argmax:window=50@frame", "cen+argmax@frame"]
    assert [r.who.method for r in both.records] == names
    assert [r.who.region for r in both.records] == ["target", "target", "frame", "frame"]
    for record, region in ((both.records[0], "target"), (both.records[2], "frame")):
        assert (record.judgement.frame, record.who.code) == (alone[region].judgement.frame, alone[region].who.code)
    # Conditions, such as the mean rate, describe the sequence, not the region where a method looks.
    assert alone["target"].what.mean_rate != alone["frame"].what.mean_rate
    assert {record.what.mean_rate for record in both.records} == {alone["target"].what.mean_rate}
    assert {row.method for row in rank_methods(both.records)} == set(names)
    (sweep,) = both.sweeps
    assert [curve.measure for curve in sweep.curves] == ["sd", "cen"]


@pytest.mark.slow
def test_a_method_may_name_its_region(two_depths):
    found = evaluate(two_depths, methods=["sd+argmax", "sd+argmax@frame", "sd+argmax@target"], region="frame")
    assert {r.who.method: r.who.region for r in found.records} == {
        "sd+argmax": "frame",
        "sd+argmax@frame": "frame",
        "sd+argmax@target": "target",
    }
    both = evaluate(two_depths, methods=["sd+argmax", "sd+argmax@frame"], region="both")
    assert [r.who.method for r in both.records] == ["sd+argmax", "sd+argmax@frame"]


def test_an_at_elsewhere_in_a_method_is_no_region(tmp_path):
    (tmp_path / "at@home.py").write_text(PARTS)
    for end, region in (("", ""), ("@frame", "frame")):
        assert parse_method(f"{tmp_path}/at@home.py:Range+argmax{end}").region == region


@pytest.mark.slow
def test_a_sequence_that_breaks_in_the_second_region_is_a_failure(dataset, tmp_path):
    """Its spikes are damaged once the method has answered for the first region."""
    copy = shutil.copytree(dataset, tmp_path / "copy")
    path, steps = copy / "test/board2-ramp-0.h5", []
    with h5py.File(path) as file:
        chunk = file["spikes"].id.get_chunk_info(0)

    def tear(*step):
        steps.append(step)
        if step[2] == "board2-ramp-0 sd+argmax":
            with path.open("r+b") as raw:
                raw.seek(chunk.byte_offset)
                raw.write(b"\xff" * chunk.size)
            BLOCK_MEMORY.reset()  # a longer recording would not stay in it

    found = evaluate(copy, methods=["sd+argmax"], split="all", region="both", progress=tear)
    (failure,) = found.failures
    assert (failure.sequence, "damaged" in failure.problem) == ("board2-ramp-0", True)
    assert {r.what.light for r in found.records} == {sweep.light for sweep in found.sweeps} == {"constant"}
    assert steps[-1][:2] == (6, 6)


class Abstains:
    def __call__(self, view):
        view.score(0, 100)
        return Answer(None, note="nothing seen")


def raising(error):
    """Return a measure or search that raises ``error``."""

    def part(view_or_counts):
        raise error

    return part


def test_an_abstention_is_recorded_apart_from_errors(stream_file, register):
    register("searches", "mine", Abstains)
    record = one(stream_file, "sd+mine")
    assert (record.judgement.status, record.judgement.note) == ("abstained", "nothing seen")
    assert (record.judgement.frame, record.judgement.error, record.success()) == (None, None, False)
    assert record.judgement.frames_seen == 100
    assert record.judgement.lens_travel == pytest.approx(99 / 799, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("search", "note"),
    [
        (lambda view: Answer(1e6), "answered frame 1000000.0, which was not recorded"),
        (raising(RuntimeError("two\nlines")), "RuntimeError: two lines"),
        (raising(AssertionError()), "AssertionError"),
        (raising(OSError("no weights")), "OSError: no weights"),
        (raising(OSError("no /w\udcff.pt")), "OSError: no /w\\udcff.pt"),
        (lambda view: Answer(5, note="w\udcff"), "its note is 'w\\udcff'; give one line of text"),
        (raising(BadInput("too dark", where="x")), "BadInput: x: too dark"),
        (lambda view: 1234.5, "it answers with float 1234.5; return saf_gen.parts.Answer(frame), or "),
        (
            lambda view: Answer(5, trace=(np.nan,)),
            "its trace is no flat tuple of finite numbers: (nan,); give the positions, for example",
        ),
        (lambda view: Answer(np.nan), "it answers frame nan; give a finite number, or None to abstain"),
        (lambda view: Answer(10**400), "OverflowError: int too large to convert to float"),
        (lambda view: Answer(position=0.5), "it answers with a position, but does not command the lens; answer"),
    ],
)
def test_a_wrong_answer_or_an_exception_is_a_failure_of_that_method_only(dataset, register, search, note):
    """Even an OSError, which from the data would be a failure of the sequence."""
    register("searches", "mine", search)
    result = evaluate(dataset, methods=["sd+mine", "sd+argmax"], split="test")
    assert result.failures == ()
    assert [r.judgement.status for r in result.records] == ["failed", "answered"] * 2
    assert (result.records[0].judgement.frame, result.records[0].success()) == (None, False)
    assert result.records[0].judgement.note.startswith(note)
    assert len(result.records[0].judgement.note.splitlines()) == 1
    assert result.records[0].judgement.note.encode("utf-8")  # it can be written to a file


def test_a_broken_measure_is_a_failure_of_its_method(stream_file, register):
    register("measures", "dark", raising(RuntimeError("no light")))
    record = one(stream_file, "dark+argmax")
    assert (record.judgement.status, record.judgement.note) == ("failed", "RuntimeError: no light")


def test_an_interrupt_stops_the_evaluation(stream_file, register):
    register("searches", "mine", raising(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        one(stream_file, "sd+mine")


def test_any_kind_of_number_is_an_answer(stream_file, register):
    register("searches", "mine", lambda view: Answer(Fraction(601, 2), (np.float32(0.5), 1)))
    record = one(stream_file, "sd+mine")
    assert (record.judgement.status, record.judgement.frame, record.judgement.trace) == ("answered", 300.5, (0.5, 1.0))


def test_damage_that_only_a_method_reads_is_not_a_failure_of_the_method(tmp_path, register):
    """The last 50 frames, which are not read for the mean rate, are damaged while the method runs."""
    path = tmp_path / "torn.h5"
    write_stream(path, make_spikes(20, shape=(20_050, 8, 8)))
    with h5py.File(path) as file:
        chunk = file["spikes"].id.get_chunk_info_by_coord((0, 0, 2500))

    def tear_and_score(view):
        with path.open("r+b") as raw:
            raw.seek(chunk.byte_offset)
            raw.write(b"\xff" * chunk.size)
        BLOCK_MEMORY.reset()  # a longer recording would not stay in it
        return Answer(view.score(20_000, 20_050))

    register("searches", "mine", tear_and_score)
    assert refusal(evaluate, path, methods=["sd+mine"], draw=False).where.endswith("torn.h5")


def darken(file):
    file["spikes"][...] = 0


def flip_the_last_bit(file):
    file["spikes"][-1, -1, -1] ^= 128


def move_the_lens(file):
    del file.attrs["spikes_sha256"]  # with which opening the file would tell
    file["focus/position"][:5] = 0.5


def state_another_digest(file):
    file.attrs["content_sha256"] = "0" * 64


@pytest.mark.slow
@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize("change", [darken, flip_the_last_bit, move_the_lens, state_another_digest])
def test_no_record_names_a_content_that_is_not_in_the_file(dataset, tmp_path, change, listed):
    """Methods see a part of a recording, and in the closed loop hardly any of it."""
    copy = shutil.copytree(dataset, tmp_path / "copy")
    path = copy / "test/board2-constant-0.h5"
    if not listed:  # as if the streams were links
        document = json.loads((copy / "manifest.json").read_text()) | {"files": []}
        del document["checksum"]
        (copy / "manifest.json").write_text(json.dumps(document))
    assert [record.what.sequence for record in evaluate(copy, methods=["sd+argmax"]).records] == [
        path.stem,
        "board2-ramp-0",
    ]
    with h5py.File(path, "r+") as file:
        change(file)
    found = evaluate(copy, methods=["sd+argmax"])
    assert [record.what.sequence for record in found.records] == ["board2-ramp-0"]
    assert [failure.sequence for failure in found.failures] == [path.stem]
    assert_says(BadInput(found.failures[0].problem), f"{path}: the content has SHA-256")
    assert_says(refusal(one, path, "sd+argmax"), f"{path}: the content has SHA-256")
    protocol = ClosedLoopProtocol(get_actuator("voice_coil_hall"), budget_s=0.1, sweep_s=0.05)
    error = refusal(evaluate, copy, methods=["sd+golden_section"], protocol=protocol)
    assert_says(error, f"{path}: the content has SHA-256")


@pytest.mark.slow
def test_a_file_of_other_bytes_with_the_same_content_is_judged(dataset, tmp_path):
    """Another program stored it without compression."""
    copy = shutil.copytree(dataset, tmp_path / "copy")
    path = copy / "test/board2-constant-0.h5"
    with h5py.File(path, "r+") as file:
        spikes, attributes = file["spikes"][...], dict(file["spikes"].attrs)
        del file["spikes"]
        file.create_dataset("spikes", data=spikes, chunks=(5, 7, 11)).attrs.update(attributes)
    assert evaluate(copy, methods=["sd+argmax"]).records[0].what.data == evaluate(dataset).records[0].what.data


@pytest.mark.slow
def test_sweeps_are_kept_for_drawn_sequences_and_curve_quality_for_all(tmp_path):
    """Of two sequences of one condition, the first is drawn."""
    for name in ("a", "b"):
        write_sweep(tmp_path / "test" / f"{name}.h5", 400)
    listed = list_streams(tmp_path, {"id": "a"}, {"id": "b"})
    found = evaluate(listed, methods=["sd+argmax"])
    assert [sweep.sequence for sweep in found.sweeps] == ["a"]
    assert [(curve.measure, curve.sequence) for curve in found.curves] == [("sd", "a"), ("sd", "b")]
    assert found.curves[0].quality == found.curves[1].quality


def test_the_view_of_a_recording_has_only_the_promised_members(stream_file, register):
    held = []

    def looks(view):
        held.append(view)
        return Answer()

    register("searches", "mine", looks)
    assert one(stream_file, "sd+mine").judgement.status == "abstained"
    promised = {name for name in vars(View) if not name.startswith("_")}
    assert {name for name in dir(held[0]) if not name.startswith("_")} == promised


def test_a_failure_is_no_success_even_where_an_abstention_would_be(tmp_path, register):
    lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
    write_stream(tmp_path / "out.h5", make_spikes(1200.0), focus_position=lens, truth=make_truth(1200.0))
    register("searches", "mine", raising(ZeroDivisionError("no light")))
    assert one(tmp_path / "out.h5", "sd+mine").success() is False
    register("searches", "mine", Abstains)
    assert one(tmp_path / "out.h5", "sd+mine").success() is True


@pytest.mark.slow
def test_every_method_meets_every_sequence_in_order(dataset):
    steps = []
    methods = ["sd+argmax", "er_count+argmax"]
    out = evaluate(dataset, methods=methods, split="all", progress=lambda *step: steps.append(step))
    assert [(r.what.sequence, r.who.method) for r in out.records] == [
        (sequence, method)
        for sequence in ("board-constant-0", "board2-constant-0", "board2-ramp-0")
        for method in ("sd+argmax", "er_count+argmax")
    ]
    assert out.failures == ()
    assert sorted({done for done, _, _ in steps}) == [1, 2, 3, 4, 5, 6]  # one more as a sequence ends
    assert {total for _, total, _ in steps} == {6}


@pytest.mark.slow
def test_a_split_and_a_scene_motion_pick_their_sequences_and_an_unknown_one_is_named(dataset):
    assert len(evaluate(dataset, methods=["sd+argmax"], split="all", scene_motion="static").records) == 3
    error = refusal(evaluate, dataset, methods=["sd+argmax"], scene_motion="dynamic")
    assert ("'dynamic'" in error.problem, error.allowed) == (True, "static")
    assert {r.what.split for r in evaluate(dataset, methods=["sd+argmax"], split="train").records} == {"train"}
    error = refusal(evaluate, dataset, split="tset")
    assert (error.allowed, error.nearest) == ("all, test, train", "test")


def test_the_curves_are_what_argmax_looked_at(dataset):
    (sweep,) = evaluate(dataset, methods=["sd+argmax:window=50", "sd+egs_code"], split="train").sweeps
    (curve,) = sweep.curves
    with open_stream(dataset / "train" / "board-constant-0.h5") as stream:
        first, scores = score_blocks(stream, "sd", window=50)
    np.testing.assert_array_equal(curve.frames, first + 24.5)
    np.testing.assert_array_equal(curve.scores, scores)
    assert curve.answer == curve.frames[np.argmax(scores)]
    assert sweep.rate.mean() == pytest.approx(0.25, rel=0.02)


def test_a_sequence_that_cannot_be_read_or_is_another_is_named_and_the_others_go_on(dataset, tmp_path):
    copy = shutil.copytree(dataset, tmp_path / "copy")
    cut = copy / "test/board2-constant-0.h5"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    write_sweep(copy / "train" / "board-constant-0.h5", 500.0)
    found = evaluate(copy, methods=["sd+argmax"], split="all")
    assert [r.what.sequence for r in found.records] == ["board2-ramp-0"]
    problems = {failure.sequence: failure.problem for failure in found.failures}
    assert "not the stream that the manifest names" in problems["board-constant-0"]
    assert "board2-constant-0.h5" in problems["board2-constant-0"]


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("cut.h5", {}, "cut.h5"),
        ("nothing", {}, "saf-gen generate"),
        ("sweep.h5", {"region": "targt"}, "did you mean 'target'"),
        ("sweep.h5", {"split": "test"}, "single stream"),
        ("sweep.h5", {"scene_motion": "static"}, "single stream"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(stream_file, tmp_path, name, options, words):
    (tmp_path / "sweep.h5").symlink_to(stream_file)
    (tmp_path / "cut.h5").write_bytes(stream_file.read_bytes()[:3000])
    assert words in str(refusal(evaluate, tmp_path / name, methods=["sd+argmax"], **options))


def test_a_score_curve_is_the_measure_of_consecutive_blocks(stream_file):
    with open_stream(stream_file) as stream:
        first, scores = score_blocks(stream, "sd", window=150)
        assert first.tolist() == [0, 150, 300, 450, 600]  # the last 50 frames fill no block
        sd = get_measure("sd")
        assert scores.tolist() == [sd(stream.counts(a, a + 150)) for a in first]


@pytest.mark.parametrize("window", [0, 801, 2.5])
def test_a_window_that_fits_no_block_is_refused(stream_file, window):
    with open_stream(stream_file) as stream:
        error = refusal(score_blocks, stream, "sd", window=window)
    assert str(window) in error.problem
    assert "800" in error.allowed
