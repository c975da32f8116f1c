"""SAF's recordings under SAF's protocol: its block lengths, the last frame of the best block, and a manual truth."""

import csv
import json

import numpy as np
import pytest
from handmade_records import record
from planted_sweeps import make_spikes
from reference_searches import literal_egs
from refusals import refusal
from scipy.stats import kendalltau
from spreadsheets import HEADING, write_xlsx

from saf_gen.benchmark import thumbnails
from saf_gen.benchmark.records import read_records, write_records
from saf_gen.leaderboard.rank_agreement import compare_scores
from saf_gen.leaderboard.saf import rank_on_saf
from saf_gen.stream.interop import export_raw_frames
from saf_gen.stream.stream_writer import write_stream

pytestmark = pytest.mark.slow

FRAMES = 160
LISTED = {"desk": (60, 8), "leaf": (97, 16), "wheel": (41, 8)}
"""Peak frame (from 0) and frames per block of each scene's recording."""
METHODS = ("sd_code+argmax", "sd_code+egs_code", "er_count+argmax", "sd_code+argmax:window=40")


def spikes_of(peak):
    """Spikes of a tenth of the camera's height and width; recordings repeat them ten times in each direction."""
    return make_spikes(peak, shape=(FRAMES, 25, 40))


@pytest.fixture(scope="module", autouse=True)
def _few_pictures():
    """Pages have two pictures of a recording instead of 48, as no test looks at them and all are kept on disk."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(thumbnails, "THUMBNAIL_COUNT", 2)
        yield


@pytest.fixture(scope="module")
def saf(tmp_path_factory):
    """A folder like that of SAF's authors: ``datasets/config.xlsx``, and raw files in layout 416."""
    root = tmp_path_factory.mktemp("SAF") / "datasets"
    rows = [HEADING]
    for number, (scene, (peak, block)) in enumerate(LISTED.items(), start=1):
        write_stream(root / f"{scene}.h5", np.tile(spikes_of(peak), (1, 10, 10)))
        export_raw_frames(root / f"{scene}.h5", root / f"{scene}.dat", layout="416")
        (root / f"{scene}.h5").unlink()
        rows.append((number, scene, FRAMES, peak + 1, block, f"datasets\\{scene}.dat"))
    write_xlsx(root / "config.xlsx", rows)
    return root


@pytest.fixture(scope="module")
def ranked(saf, tmp_path_factory):
    """The folder and the result of a ranking, together with an evaluation of generated data."""
    out = tmp_path_factory.mktemp("ranked")
    beside = [
        record(method, f"s{scene}", 0.1 if n <= scene else 4.0, scene=f"s{scene}")
        for n, method in enumerate(METHODS)
        for scene in range(3)
    ]
    write_records(out / "bench/evaluation/records.jsonl", beside)
    return out, rank_on_saf(saf, out / "mine", methods=METHODS, beside=[out / "bench/evaluation"])


def test_an_evaluation_of_several_splits_is_reported(saf, tmp_path):
    records = [record("far+argmax", name, 0.1, split=name) for name in ("train", "test")]
    write_records(tmp_path / "mixed" / "records.jsonl", records)
    lines = []
    refusal(rank_on_saf, saf, tmp_path / "o", beside=[tmp_path / "mixed"], notify=lines.append)
    assert lines == ["mixed ranks several splits together: train, test"]


def best_block(peak, block):
    """The last frame, counted from 1, of the block with the largest spike dispersion, computed directly."""
    blocks = spikes_of(peak)[: FRAMES // block * block].reshape(-1, block, 25, 40).sum(axis=1, dtype=float)
    scores = [((c - c.mean()) ** 2).sum() / c.mean() ** 2 for c in blocks]
    return (int(np.argmax(scores)) + 1) * block


def test_answers_are_the_frames_that_the_released_code_prints(ranked):
    found = {(a.method, a.scene): a for a in ranked[1].answers}
    for scene, (peak, block) in LISTED.items():
        assert found["sd_code+argmax", scene].printed == best_block(peak, block)
        assert found["sd_code+argmax:window=40", scene].printed == best_block(peak, 40)
        printed = literal_egs(Sweep(spikes_of(peak)), 1, FRAMES)[-1]
        assert found["sd_code+egs_code", scene].printed == printed
        assert found["sd_code+argmax", scene].truth == peak + 1
        blocks = best_block(peak, block) // block - 1 - (peak + 1) // block
        assert found["sd_code+argmax", scene].blocks == abs(blocks)


class Sweep:
    def __init__(self, frames):
        self.total = np.concatenate(
            [np.zeros((1, *frames.shape[1:]), np.uint32), frames.cumsum(axis=0, dtype=np.uint32)]
        )

    def score(self, first, stop):
        counts = self.total[stop].astype(float) - self.total[first]
        return ((counts - counts.mean()) ** 2).sum() / counts.mean() ** 2


def test_our_answers_are_the_centres_of_the_searches_windows(ranked):
    own = {(r.method, r.scene): r.frame + 1 for r in ranked[1].own.records}
    for answer in ranked[1].answers:
        assert answer.own == own[answer.method, answer.scene]
        assert answer.own_error == answer.own - answer.truth
        assert answer.fraction_off(answer.error) == abs(answer.error) / FRAMES


def test_the_ranking_is_by_the_mean_fraction_and_no_answer_is_the_largest_error(ranked):
    answer = next(a for a in ranked[1].answers if a.scene == "leaf")
    assert answer.fraction_off(None) == 97 / FRAMES
    for row in ranked[1].rows:
        off = [abs(a.error) / FRAMES for a in ranked[1].answers if a.method == row.method]
        assert row.off == pytest.approx(np.mean(off))
        assert row.rank == 1 + sum(other.off < row.off for other in ranked[1].rows)
    assert ranked[1].rows[-1].method == "er_count+argmax"


def test_ranks_are_compared_with_those_of_generated_data(ranked):
    theirs, beside, own_beside = ranked[1].agreement
    rows = ranked[1].rows
    assert theirs.tau == pytest.approx(kendalltau([r.off for r in rows], [r.own_off for r in rows]).statistic)
    success = [r.beside[0] for r in rows]
    assert beside.tau == pytest.approx(kendalltau([-r.off for r in rows], success).statistic)
    assert beside.low <= beside.tau <= beside.high
    assert (beside.first, beside.second, beside.scenes, beside.shared) == ("SAF's protocol", "bench", 6, 0)
    assert own_beside.second == "bench"


@pytest.mark.slow
def test_the_command_writes_the_ranking_and_says_what_is_not_known(call, saf, tmp_path):
    methods = [word for method in METHODS[:3] for word in ("--method", method)]
    code, shown, err = call("leaderboard", "saf", saf, "--out", tmp_path / "out", *methods)
    assert (code, err) == (0, "")
    shown = " ".join(shown.split())
    assert "3 methods on 3 recordings of 3 scenes" in shown
    assert "state neither a limit within which an answer is right" in shown
    assert "the depth of focus and success within it are unknown" in shown
    document = json.loads((tmp_path / "out/ranking.json").read_text())
    assert [row["method"] for row in document["rows"]][-1] == "er_count+argmax"
    with (tmp_path / "out/answers.csv").open() as file:
        assert {line["scene"] for line in csv.DictReader(file)} == set(LISTED)
    assert len(read_records(tmp_path / "out/ours")) == 9
    assert "| rank | method |" in (tmp_path / "out/ranking.md").read_text()
    assert not list((tmp_path / "out").glob(".*"))
    again = call("leaderboard", "saf", saf, "--out", tmp_path / "out", "--method", "er_count+argmax", "--json")
    assert json.loads(again[1])[0]["method"] == "er_count+argmax"


def test_what_cannot_be_ranked_is_one_line(call, saf, ranked, tmp_path):
    (tmp_path / "desk.dat").write_bytes((saf / "desk.dat").read_bytes())
    write_xlsx(tmp_path / "config.xlsx", [HEADING, (1, "desk", FRAMES, 61, "", "desk.dat")])
    assert "has no dt" in refusal(rank_on_saf, tmp_path, tmp_path / "out").problem
    write_stream(tmp_path / "out/recordings/blocks-8/other.h5", np.zeros((8, 4, 4), np.uint8))
    assert "is not a recording of" in refusal(rank_on_saf, saf, tmp_path / "out").problem
    racing = [record("sd+argmax", "s", 0.1, track="closed_loop", terms="x")]
    write_records(tmp_path / "loop/records.jsonl", racing)
    code, out, err = call("leaderboard", "saf", saf, "--out", tmp_path / "o", "--beside", tmp_path / "loop")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "loop is an evaluation of the closed loop" in err
    write_records(tmp_path / "far/records.jsonl", [record("there.py:Mine+argmax", "s", 0.1)])
    error = refusal(rank_on_saf, saf, tmp_path / "o", beside=[tmp_path / "far"])
    assert "no method of far is available" in error.problem
    error = refusal(rank_on_saf, saf, tmp_path / "o", methods=["sd+golden_section"])
    assert "commands the lens" in error.problem
    assert not (tmp_path / "o").exists()


def interrupted(*_, **__):
    raise KeyboardInterrupt


THEIRS = """
import os
from saf_gen.parts import Answer
from saf_gen.plugins.measures import get_measure

def copy(counts):
    return get_measure("sd_code")(counts)

def ends(view):
    os._exit(0)

def asks_for_truth(view):
    walked = [view, view._view, view._view._line]
    return Answer(0.0 if any(hasattr(one, "truth") or hasattr(one, "_counts") for one in walked) else 7.0)
"""


def test_methods_of_others_are_guests_and_answer_the_same(call, saf, tmp_path):
    (tmp_path / "theirs.py").write_text(THEIRS)
    own, bad = f"{tmp_path}/theirs.py:copy", [f"sd+{tmp_path}/theirs.py:{name}" for name in ("ends", "asks_for_truth")]
    shipped = ["sd_code+argmax", "sd_code+egs_code", "sd_code+argmax:window=40"]
    methods = [*shipped, *(name.replace("sd_code", own, 1) for name in shipped), *bad]
    options = [part for name in methods for part in ("--method", name)]
    code, _, err = call("leaderboard", "saf", saf, "--out", tmp_path / "out", *options)
    assert (code, err.count("\n")) == (1, 1)
    assert f"{bad[0]} failed on 6 runs: its process ended with exit code 0" in err
    with (tmp_path / "out/answers.csv").open() as file:
        rows = list(csv.DictReader(file))
    answers = {name: [row | {"method": ""} for row in rows if row["method"] == name] for name in methods}
    for name in shipped:
        assert answers[name] == answers[name.replace("sd_code", own, 1)]
    assert [{row["own"] for row in answers[name]} for name in bad] == [{""}, {"8.0"}]


@pytest.mark.slow
def test_a_stopped_ranking_goes_on(call, saf, tmp_path, monkeypatch):
    command = ("leaderboard", "saf", saf, "--out", tmp_path, "--method", "er_count+argmax")
    with monkeypatch.context() as patch:
        patch.setattr("saf_gen.leaderboard.report.write_evaluation", interrupted)
        stopped = "saf-gen: stopped; finished work is kept: run the same command again to continue\n"
        assert call(*command) == (130, "", stopped)
        assert not (tmp_path / "ranking.json").exists()
    code, _, err = call(*command)
    assert (code, err) == (0, "3 recordings had been evaluated by a run that was stopped\n")


def test_two_scenes_have_a_tau_and_no_interval():
    scores = {scene: {"a": 3.0, "b": 2.0, "c": 1.0} for scene in ("desk", "leaf")}
    found = compare_scores(("one", scores), ("other", scores), condition="ranking")
    assert (found.tau, found.low, found.shared, found.by_chance) == (1.0, None, 2, None)
    assert compare_scores(("one", scores), ("other", {"desk": {"a": 1.0}}), condition="ranking") is None
