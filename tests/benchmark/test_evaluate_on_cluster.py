"""Evaluation and scene checks on a Dask cluster give the same results as on one machine."""

import json

import numpy as np
import pytest
from handmade_records import change
from planted_sweeps import write_three_sweeps

from saf_gen.benchmark import evaluate as module
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.core.execution import SchedulerLost
from saf_gen.core.finding import Finding
from saf_gen.errors import SafGenError

MINE = "import numpy as np\n\ndef spread(counts: np.ndarray) -> float:\n    return float(np.ptp(counts))\n"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_three_sweeps(tmp_path_factory.mktemp("data"))


def plain(result):
    """Return records without their computing time, and parts of the sweeps with arrays as bytes."""
    records = [change(record, seconds=0.0, reference_rate=None) for record in result.records]
    return records, [(s.sequence, np.asarray(s.rate).tobytes(), s.thumbnails is not None) for s in result.sweeps]


@pytest.mark.slow
def test_an_evaluation_on_a_cluster_gives_the_same_in_the_same_order(dataset, cluster_address, tmp_path, monkeypatch):
    """This includes a method in a user's file, and predictions."""
    (tmp_path / "mine.py").write_text(MINE)
    answers = [{"method": "theirs", "sequence": name, "frame": 300.0} for name in ("one", "two", "three")]
    (tmp_path / "answers.jsonl").write_text("".join(json.dumps(answer) + "\n" for answer in answers))
    monkeypatch.chdir(tmp_path)
    steps = []
    how = {"methods": ["sd+argmax", "mine.py:spread+argmax"], "predictions": "answers.jsonl", "region": "both"}
    found = evaluate(dataset, cluster=cluster_address, progress=lambda *step: steps.append(step), **how)
    assert found.failures == ()
    assert plain(found) == plain(evaluate(dataset, **how))
    assert len(found.records) == 3 * 5
    assert [done for done, _, _ in steps] == [4, 8, 12]


def test_a_method_that_was_changed_meanwhile_is_a_failure_that_says_so(dataset, cluster_address, tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("saf_gen.benchmark.sequence_evaluation._codes", lambda groups: (("x", str(id(groups))),))
    found = evaluate(dataset, methods=["mine.py:spread+argmax"], cluster=cluster_address)
    assert len(found.failures) == 3
    assert "has different code on a worker" in found.failures[0].problem


@pytest.mark.slow
def test_what_was_evaluated_before_the_scheduler_was_lost_is_kept(dataset, cluster_address, tmp_path, monkeypatch):
    def lost_after_one(jobs, **how):
        yield next(iter(run(jobs, **how)))
        raise SchedulerLost("the Dask scheduler at tcp://there:1 does not answer any more")

    run = module.run_jobs
    monkeypatch.setattr(module, "run_jobs", lost_after_one)
    with pytest.raises(SafGenError, match=r"tcp://there:1 .*; 1 of 3 sequences evaluated and kept; start a sched"):
        evaluate(dataset, methods=["sd+argmax"], cluster=cluster_address, keep=KeptSequences(tmp_path / "kept"))
    monkeypatch.undo()
    kept = KeptSequences(tmp_path / "kept")
    assert len(evaluate(dataset, methods=["sd+argmax"], keep=kept).records) == 3


def test_scenes_are_checked_on_a_cluster_with_the_same_findings(test_scenes, cluster_address, call, monkeypatch):
    def check_scene(scene, sensor, **how):
        yield Finding("detail", "warning", f"{scene.id} under {sensor.rows} rows with {how['backend']}")

    monkeypatch.setattr("saf_gen.authoring.checks.check_scene", check_scene)
    options = ("scenes", "check", "plane", "workbench", "--json", "--variant", "scalar")
    code, found, err = call(*options, "--cluster", cluster_address)
    by_scene = {finding["scene"]: finding for finding in json.loads(found)}
    assert (code, err) == (0, "")
    assert by_scene == {finding["scene"]: finding for finding in json.loads(call(*options)[1])}
    assert set(by_scene) == {"plane", "workbench"}
