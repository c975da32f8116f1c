"""Methods that need what a camera does not see are refused in one line, whatever the camera, and wherever they run."""

import numpy as np
import pytest
from refusals import assert_says, refusal

import saf_gen
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.suitability import measure_misfit, method_misfit
from saf_gen.stream.event_file import EventColumns, EventWriter
from saf_gen.stream.metadata import Metadata

SHAPE = 160, 10, 12
GUEST = '''
class Middle:
    """The middle frame."""
    causal = False
    def __call__(self, view):
        view.score(0, view.frames)
        return __import__("saf_gen").parts.Answer(view.frames / 2)
class Both(Middle):
    """The middle frame, by two measures."""
    measures = ("sd_debiased",)
class Sum:
    """The sum of the counts."""
    degree = 1
    score_range = "from 0"
    def __call__(self, counts):
        return float(counts.sum())
'''


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A folder with a search and a measure of others, recordings of photons and of events; the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(GUEST)
    saf_gen.write_stream("photons.h5", np.random.default_rng(1).random(SHAPE) < 0.3, kind="photons")
    with EventWriter(tmp_path / "events.h5", shape=SHAPE, readout_hz=1000.0, metadata=Metadata()) as writer:
        t = np.arange(0, 160_000, 100, dtype=np.uint32)
        writer.write(EventColumns(t % 12, t % 10, t, (t // 100 % 2).astype(np.uint8)))
    return tmp_path


@pytest.mark.parametrize(
    ("method", "form", "words"),
    [
        ("sd_debiased+argmax", "bits", "corrects for the noise of spikes, and these recordings hold voltages"),
        ("sd+pbf_events", "bits", "needs events with their polarities, and these recordings hold voltages"),
        ("sd+pbf_events", "events", ""),
        ("sd_tfi+argmax", "frames", "needs intervals between spikes, and these recordings hold voltages"),
        ("sd_tfi+argmax", "bits", ""),
        ("er_count+elp", "events", "makes events of spikes, and these recordings hold voltages | use elp_events"),
        ("er_count+elp", "bits", ""),
        (
            "sd+peak_fit",
            "bits",
            "scores by sd_calibrated, which corrects for the noise of spikes | voltages | such as sd",
        ),
        ("octave_structure+peak_fit", "frames", "scores by sd_calibrated, which corrects for the noise of spikes"),
        ("sd+coarse_to_fine:far=sd_tfi", "events", "scores by sd_tfi, which needs intervals between spikes"),
        ("sd+coarse_to_fine:far=change_rate", "events", "scores by change_rate, which makes events of spikes"),
        ("sd+coarse_to_fine", "events", ""),
        ("sd_debiased+photon_aware", "bits", "photon_aware corrects for the noise of spikes"),
        ("sd+argmax:reject=true", "events", ""),
        ("sd+argmax", "frames", ""),
    ],
)
def test_a_camera_of_a_kind_of_its_own_is_judged_by_the_form_of_its_recordings(method, form, words):
    error = method_misfit(parse_method(method), "voltages", form=form)
    assert (error is None) == (words == "")
    if error is not None:
        assert_says(error, f"{method} | {words}")


@pytest.mark.parametrize("measure", ["sd_calibrated", "sd_calibrated:dark=0.01", saf_gen.get_measure("sd_debiased")])
def test_a_measure_that_corrects_for_spikes_suits_spikes_alone(measure):
    assert measure_misfit(measure, "spikes", form="bits") is None
    error = measure_misfit(measure, "voltages", form="frames")
    assert_says(error, "corrects for the noise of spikes, and this recording holds voltages | such as sd")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recording", "method", "words"),
    [
        ("photons.h5", "sd_debiased+mine.py:Middle", "corrects for the noise of spikes | single photons"),
        ("events.h5", "sd_tfi+mine.py:Middle", "needs intervals between spikes | hold events"),
        ("events.h5", "mine.py:Sum+pbf", "makes events of spikes | hold events | use pbf_events"),
        ("photons.h5", "sd+mine.py:Both", "scores by sd_debiased, which corrects for the noise of spikes"),
        ("photons.h5", "mine.py:Sum+peak_fit", "scores by sd_calibrated, which corrects for the noise of spikes"),
        ("photons.h5", "folder/", "folder/ corrects for the noise of spikes | single photons"),
    ],
)
def test_a_method_of_others_is_refused_for_what_it_uses_of_ours(mine, recording, method, words):
    (mine / "folder").mkdir()
    (mine / "folder/search.py").write_text(GUEST)
    (mine / "folder/method.yaml").write_text(
        "name: mine\nmeasure: sd_debiased\nsearch: search.py:Middle\nfiles: [search.py]\ndescription: x\n"
    )
    assert_says(refusal(evaluate, mine / recording, methods=[method]), words)


def test_of_the_baselines_those_that_do_not_suit_are_left_out_and_a_named_method_is_refused(mine, monkeypatch):
    monkeypatch.setattr("saf_gen.benchmark.evaluate.DEFAULT_RECORDED_METHODS", ("sd+argmax", "sd_debiased+argmax"))
    lines = []
    ran = evaluate(mine / "photons.h5", methods=["er_count+argmax", "baselines"], tell=lines.append).records
    assert [record.who.method for record in ran] == ["er_count+argmax", "sd+argmax"]
    assert lines == ["left out, because these recordings hold single photons: sd_debiased+argmax"]
    error = refusal(evaluate, mine / "photons.h5", methods=["baselines", "sd_debiased+argmax"])
    assert_says(error, "sd_debiased+argmax corrects for the noise of spikes")


@pytest.mark.slow
def test_other_methods_of_others_take_every_camera(mine):
    for recording in ("photons.h5", "events.h5"):
        (record,) = evaluate(mine / recording, methods=["sd+mine.py:Middle"]).records
        assert (record.judgement.frame, record.judgement.note) == (80.0, "")
