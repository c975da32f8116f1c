"""Constants tuned on train: the combinations, the best of them, their file, and the records that cite it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from handmade_records import change
from planted_sweeps import SHAPE, list_streams, make_spikes, write_sweep
from refusals import refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.method_spec import TunedMethod, TuningTrial, format_tuned, parse_method, read_tuned
from saf_gen.leaderboard import Leaderboard, rank_methods
from saf_gen.leaderboard.report import write_evaluation
from saf_gen.leaderboard.tuning import MAX_TRIALS, draw_trials, expand_grid, find_objective, tune
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder, splits = tmp_path_factory.mktemp("data"), {"train": 300.0, "test": 500.0}
    for split, peak in splits.items():
        write_sweep(folder / split / f"{split}-one.h5", peak)
    return list_streams(folder, *({"id": f"{split}-one", "split": split, "scene": split} for split in splits))


def test_variants_are_all_combinations_with_the_fixed_options():
    assert expand_grid("cen:highest=0.1+argmax:window=50", {"search.refine": ["parabola", "no"]}) == [
        "cen:highest=0.1+argmax:window=50,refine=parabola",
        "cen:highest=0.1+argmax:window=50,refine=no",
    ]
    values = {"measure.highest": ["0.1", "0.2"], "search.window": ["50", "100", "200"]}
    found = expand_grid("cen+argmax", values)
    assert len(set(found)) == 6
    assert expand_grid("sd+argmax:window=50@frame", {"search.window": ["100"]}) == ["sd+argmax:window=100@frame"]
    assert found[1] == "cen:highest=0.1+argmax:window=100"


@pytest.mark.parametrize(
    ("values", "field", "fragment"),
    [
        ({}, "allowed", "--try search.window="),
        ({"window": ["5"]}, "problem", "'window'"),
        ({"window": ["5"]}, "allowed", "measure.KEY="),
        ({"searches.window": ["5"]}, "problem", "'searches.window'"),
        ({"search.window": ["5", ""]}, "problem", "'search.window' has an empty value"),
        ({"search.window": ["5"] * (MAX_TRIALS + 1)}, "problem", str(MAX_TRIALS + 1)),
        ({"search.window": ["5"] * (MAX_TRIALS + 1)}, "allowed", f"at most {MAX_TRIALS}"),
        ({"search.windw": ["5"]}, "nearest", "window"),
        ({"search.window": ["0"]}, "problem", "window is 0"),
    ],
)
def test_what_cannot_be_tried_is_refused(values, field, fragment):
    assert fragment in getattr(refusal(expand_grid, "sd+argmax", values), field)


DRAWS = {
    "sd+argmax": {},
    "cen:highest=0.1+valley": {},
    "gaussian_derivative_n_tfi+naive": {},
    "octave_structure+peak_fit": {},
    "tenengrad_n+egs_code@frame": {"search.ratio": ["0.6", "0.618"]},
}


@pytest.mark.parametrize(("method", "values"), DRAWS.items())
def test_every_method_has_the_same_number_of_distinct_draws_the_first_as_it_is(method, values):
    found = draw_trials(method, 24, values=values)
    assert found[0] == method
    assert len(set(found)) == 24
    assert found == draw_trials(method, 24, values=values)
    assert all(parse_method(one).region == parse_method(method).region for one in found)


@pytest.mark.slow
def test_draws_stay_in_their_ranges_and_leave_texts_alone():
    found = [parse_method(one).search_options for one in draw_trials("sd+argmax", 200)[1:]]
    windows = {options["window"] for options in found}
    assert 50 <= min(windows) < 60 < 450 < max(windows) <= 500
    assert {options["refine"] for options in found} == {"no"}
    assert all(0.5 / 3 <= options["near"] <= 1 for options in found)  # 1.5 is refused by argmax and drawn again
    still = sum(options["window"] == 100 for options in found)
    assert 35 < still < 100  # both keep their values in no draw, so a window stays in about a third: 3 sigma are 20


@pytest.mark.slow
def test_windows_last_as_long_whatever_the_camera():
    found = [parse_method(one).search_options for one in draw_trials("sd+argmax", 200, readout_hz=640.0)[1:]]
    windows = {options["window"] for options in found} - {100}  # the method's own
    assert (min(windows), max(windows)) == (2, 16)
    assert draw_trials("sd+argmax", 24) == draw_trials("sd+argmax", 24, readout_hz=20_000.0)


def test_named_values_are_drawn_too():
    found = draw_trials("sd+argmax", 60, values={"search.refine": ["parabola", "centroid"]})
    refined = [parse_method(one).search_options["refine"] for one in found]
    assert refined[0] == "no"
    assert min(refined.count(kind) for kind in ("no", "parabola", "centroid")) > 5


def test_a_method_with_few_choices_has_fewer_trials():
    found = draw_trials("sd+egs_code", 24, values={"search.ratio": ["0.618"], "search.threshold": ["10", "5"]})
    assert 2 < len(found) < 24


@pytest.mark.parametrize(
    ("method", "trials", "values", "field", "fragment"),
    [
        ("sd+argmax", 1, {}, "allowed", "2 to 1000"),
        ("sd+argmax", MAX_TRIALS + 1, {}, "problem", str(MAX_TRIALS + 1)),
        ("sd+argmax", 24, {"search.windw": ["5"]}, "nearest", "window"),
        ("sd+argmax", 24, {"search.refine": ["no", "parabla"]}, "nearest", "parabola"),
        ("sd+argmax", 24, {"window": ["5"]}, "problem", "'window'"),
        ("sd+argmx", 24, {}, "nearest", "argmax"),
    ],
)
def test_draws_that_cannot_be_made_are_refused(method, trials, values, field, fragment):
    assert fragment in getattr(refusal(draw_trials, method, trials, values=values), field)


@pytest.mark.slow
def test_the_objective_counts_answers_where_there_is_none_against_the_method(dataset):
    """Scene a: one right, one abstention where there is an answer. Scene b: a false answer, a right abstention, a
    right answer and one off by 3 depths of focus."""
    right = evaluate(dataset, methods=["sd+argmax:window=200"], split="test").records[0]
    assert right.success() is True
    missed = change(right, status="abstained")
    false = change(right, focus_off_dof=4.0, scene="b")
    rightly_silent = change(false, status="abstained")
    records = [right, missed, false, rightly_silent, change(right, scene="b")]
    assert find_objective(records) == pytest.approx((1 / 2 + (-1 + 0 + 1) / 3) / 2)
    off = change(right, scene="b", position=right.judgement.position + 0.5)
    assert find_objective([*records, off]) == pytest.approx((1 / 2 + 0 / 4) / 2)
    assert find_objective([change(right, truth=None)]) is None


@pytest.mark.slow
def test_drawn_trials_are_published_with_what_was_maximised(dataset):
    tuned, rows = tune(dataset, "sd+argmax", trials=8)
    assert len(rows) == len(tuned.trials) == 8
    assert "sd+argmax" in [trial.method for trial in tuned.trials]
    objectives = [trial.objective for trial in tuned.trials]
    assert objectives == sorted(objectives, reverse=True)


@pytest.mark.slow
def test_the_right_to_abstain_is_chosen_where_some_sweeps_have_no_answer(tmp_path):
    """Two of three sweeps end at 0.4 of the travel, before a focus at 0.75."""
    write_sweep(tmp_path / "train" / "in.h5", 300.0)
    lens, far = np.linspace(0, 0.4, SHAPE[0], dtype=np.float32), Truth(position=0.75, depth_of_focus=(0.7, 0.8))
    for name in ("early", "late"):
        write_stream(tmp_path / "train" / f"{name}.h5", make_spikes(1500.0), focus_position=lens, truth=far)
    names = ("in", "early", "late")
    dataset = list_streams(tmp_path, *({"id": name, "split": "train", "scene": name} for name in names))
    tuned, _ = tune(dataset, "sd+argmax", values={"search.reject": ["false", "true"], "search.window": ["100"]})
    assert tuned.method == "sd+argmax:reject=true,window=100"
    assert [trial.objective for trial in tuned.trials] == pytest.approx([1 / 3, -1 / 3])


def test_the_best_is_that_of_the_smallest_error_where_success_is_equal(dataset):
    """The planted focus is at 300: blocks of 200 frames have centres at 99.5, 299.5, ...; of 100 at 249.5."""
    tuned, rows = tune(dataset, "sd+argmax", values={"search.window": ["100", "200", "800"]})
    assert tuned.method == "sd+argmax:window=200"
    assert [trial.method for trial in tuned.trials] == [row.method for row in rows]
    assert tuned.trials[0].success_1dof == 1.0
    assert tuned.trials[-1].method == "sd+argmax:window=800"
    assert (tuned.split, tuned.sequences, tuned.track) == ("train", 1, "recorded")


@pytest.mark.slow
def test_what_is_found_is_written_read_and_cited(dataset, tmp_path):
    tuned, _ = tune(dataset, "sd+argmax", values={"search.window": ["100", "200"]})
    path = tmp_path / "tuned.json"
    path.write_text(format_tuned(tuned))
    assert read_tuned(path)[0] == tuned
    method = parse_method(f"@{path}")
    assert (method.name, method.tuning) == ("sd+argmax:window=200", read_tuned(path)[1])
    result = evaluate(dataset, methods=[f"@{path}", "sd+argmax"], split="test")
    record = result.records[0]
    assert record.who.tuning == method.tuning
    assert record.who.method == tuned.method
    write_evaluation(tmp_path / "out", Leaderboard.of(result), title="tuned")
    document = json.loads((tmp_path / "out" / "leaderboard.json").read_text())
    assert document["tuning"] == {tuned.method: method.tuning}
    assert f"{method.code}, constants of {method.tuning}" in (tmp_path / "out" / "index.html").read_text()


def test_a_flipped_bit_is_found_and_an_older_file_is_read(tmp_path):
    path, trial = tmp_path / "tuned.json", TuningTrial("sd+argmax", 1.0, 0.5)
    tuned = TunedMethod("sd+argmax", "made", "train", "recorded", "", "target", 1, "0", "0", (trial,))
    path.write_text(format_tuned(tuned))
    content = path.read_bytes()
    for at in range(0, len(content), 5):  # each bit of a byte in turn
        path.write_bytes(content[:at] + bytes([content[at] ^ 1 << at % 8]) + content[at + 1 :])
        assert str(path) in str(refusal(read_tuned, path))
    before = json.loads(content)
    del before["checksum"]
    path.write_text(json.dumps(before))
    assert read_tuned(path)[0] == tuned


@pytest.mark.slow
def test_constants_that_were_found_are_taken_up_again(dataset, tmp_path):
    path = tmp_path / "found.json"
    first, _ = tune(dataset, "sd+argmax", values={"search.window": ["100", "200"]})
    path.write_text(format_tuned(first))
    assert expand_grid(f"@{path}", {"search.window": ["50"], "search.refine": ["parabola"]}) == [
        "sd+argmax:window=50,refine=parabola"
    ]
    tuned, _ = tune(dataset, f"@{path}", values={"search.refine": ["parabola", "no"]})
    assert {t.method for t in tuned.trials} == {
        "sd+argmax:window=200,refine=parabola",
        "sd+argmax:window=200,refine=no",
    }


def test_a_method_that_is_named_in_several_ways_runs_once(dataset, tmp_path):
    tuned, _ = tune(dataset, "sd+argmax", values={"search.window": ["100", "200"]})
    for name in ("a.json", "b.json"):
        (tmp_path / name).write_text(format_tuned(replace(tuned, version=name)))
    specs = [f"@{tmp_path}/a.json", f"@{tmp_path}/b.json", " sd + argmax : window = 200 ", "sd+argmax"]
    steps = []
    result = evaluate(dataset, methods=specs, split="test", progress=lambda *step: steps.append(step))
    assert [r.who.method for r in result.records] == ["sd+argmax:window=200", "sd+argmax"]
    assert result.records[0].who.tuning == read_tuned(tmp_path / "a.json")[1]
    assert [row.method for row in rank_methods(result.records)] == ["sd+argmax:window=200", "sd+argmax"]
    assert {of for _, of, _ in steps} == {2}


def test_a_file_that_names_a_file_is_refused(dataset, tmp_path):
    path = tmp_path / "found.json"
    tuned, _ = tune(dataset, "sd+argmax", values={"search.window": ["100"]})
    path.write_text(format_tuned(replace(tuned, method=f"@{path}")))
    error = refusal(parse_method, f"@{path}")
    assert f"'@{path}'" in error.problem
    assert "MEASURE+SEARCH" in error.allowed


def test_nothing_is_tuned_on_test(dataset):
    values = {"search.window": ["100"]}
    error = refusal(tune, dataset, "sd+argmax", values=values, split="test")
    assert "'test'" in error.problem
    assert "train" in error.allowed
    assert refusal(tune, dataset, "sd+argmax", values=values, split="trian").nearest == "train"


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", '{"format": "saf-gen tuning 1"}', '{"format": "other", "method": "a+b"}']
)
def test_a_file_of_another_kind_is_refused(tmp_path, text):
    path = tmp_path / "tuned.json"
    path.write_text(text)
    error = refusal(parse_method, f"@{path}")
    assert str(path) in str(error)
    assert "saf-gen tune" in error.hint + error.allowed


def test_a_missing_file_is_refused_with_the_nearest(tmp_path):
    (tmp_path / "mine.json").write_text("{}")
    error = refusal(parse_method, f"@{tmp_path / 'mne.json'}")
    assert "mne.json" in str(error)
    assert error.nearest.endswith("mine.json")


def test_options_without_values_are_refused_by_the_command(call, dataset, tmp_path):
    """That it tunes, and what it says, is in tests/cli/test_splits.py."""
    command = ("tune", dataset, "--method", "sd+argmax", "--out", tmp_path / "found.json", "--try", "search.window")
    code, _, err = call(*command)
    assert (code, "allowed: KEY=VALUE,VALUE" in err) == (2, True)


def test_constants_of_a_file_may_look_elsewhere(dataset, tmp_path):
    tuned, _ = tune(dataset, "sd+argmax@target", values={"search.window": ["100", "200"]}, region="frame")
    (tmp_path / "found.json").write_text(format_tuned(tuned))
    name = f"@{tmp_path / 'found.json'}"
    assert parse_method(name).name == "sd+argmax:window=200@target"
    assert parse_method(f"{name}@frame").name == "sd+argmax:window=200@frame"
    assert parse_method(f"{name}@frame").tuning == parse_method(name).tuning != ""


def test_constants_are_tuned_for_one_region(dataset):
    error = refusal(tune, dataset, "sd+argmax", values={"search.window": ["100"]}, region="both")
    assert "'both'" in error.problem
    assert error.allowed == "centre, double, frame, half, inside, shifted, target"
