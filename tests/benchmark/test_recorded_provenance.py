"""What records take from the provenance of a recording: its grain, if it is planted there, and its sensor."""

import math
from dataclasses import asdict

import numpy as np
import pytest
import yaml
from planted_sweeps import SHAPE, list_streams, make_spikes, make_truth

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.tracks.sequence_fields import sensor_of
from saf_gen.camera import get_sensor
from saf_gen.stream.recorded_grain import GrainMoment, RecordedGrain
from saf_gen.stream.stream_writer import write_stream

NOISE = {"contrast": 0.004, "brenner": 0.03, "tenengrad": 0.5}
SIGNALS = ({"contrast": 0.1, "brenner": 0.35, "tenengrad": 9.0}, {"contrast": 0.01, "brenner": 0.05, "tenengrad": 1.0})


def planted():
    moments = tuple(GrainMoment(t, t / 800, 0.02 * (1 + n), NOISE, SIGNALS[n]) for n, t in enumerate((300, 700)))
    return RecordedGrain(moments, 0, (256, 32))


@pytest.fixture
def stream(tmp_path):
    target = np.ones(SHAPE[1:], bool)
    truth = make_truth(300.0, target=target, sharpness=np.array([0.02, 0.22, math.nan, 0.12]))

    def write(provenance):
        path = tmp_path / "test" / "a.h5"
        path.parent.mkdir()
        lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
        write_stream(path, make_spikes(300), focus_position=lens, truth=truth, provenance=provenance)
        return path

    return write


def evaluated(path, *methods, **options):
    return {record.who.method: record for record in evaluate(path, methods=methods, **options).records}


EXPECTED = {
    "sd": 0.004 / 0.2,  # the range of /truth/sharpness
    "variance_n": 0.004 / 0.2,
    "sd_tfi": 0.004 / 0.2,
    "brenner": 0.03 / 0.3,  # the range of the signal along the recording
    "brenner_n_tfi": 0.03 / 0.3,
    "tenengrad": 0.5 / 8,
    "er_count": None,
    "squared_gradient": None,  # not in the file
}


@pytest.mark.slow
def test_grain_is_compared_with_the_curve_of_the_measure_where_it_looks_at_the_target(stream, tmp_path):
    stream({"grain": planted().to_text()})
    folder = list_streams(tmp_path, {"id": "a"})
    (tmp_path / "p.jsonl").write_text('{"method": "elsewhere", "sequence": "a", "frame": 300}\n')
    methods = [f"{measure}+argmax" for measure in EXPECTED]
    found = evaluated(folder, *methods, "sd+argmax@frame", predictions=tmp_path / "p.jsonl")
    assert [record.what.grain_rms for record in found.values()] == pytest.approx([0.02] * len(found))
    assert {name: found[f"{name}+argmax"].judgement.grain_of_curve for name in EXPECTED} == pytest.approx(EXPECTED)
    assert found["sd+argmax@frame"].judgement.grain_of_curve is None
    assert found["elsewhere"].judgement.grain_of_curve is None


@pytest.mark.parametrize("provenance", [{}, {"grain": "spoilt"}])
def test_a_recording_without_grain_is_evaluated_all_the_same(stream, provenance):
    record = evaluated(stream(provenance), "sd+argmax")["sd+argmax"]
    assert record.judgement.status == "answered"
    assert (record.what.grain_rms, record.judgement.grain_of_curve) == (None, None)


def name_of(sensor):
    return sensor_of({"sensor": yaml.safe_dump(asdict(sensor), sort_keys=False)})


def test_a_sensor_has_its_name_and_one_of_other_numbers_a_digest_too():
    assert name_of(get_sensor("vidar_400x250_noisy")) == "vidar_400x250_noisy"
    quiet = name_of(get_sensor("vidar_400x250", noise={"dark": False}))
    assert quiet.startswith("vidar_400x250#")
    assert len(quiet) == len("vidar_400x250#") + 6
    assert quiet != name_of(get_sensor("vidar_400x250", rows=100))


def test_a_recording_without_a_sensor_or_with_one_that_cannot_be_read_has_none():
    assert sensor_of({}) is None
    assert sensor_of({"sensor": "pitch_m: ["}) is None
    assert sensor_of({"sensor": "name: mine"}) is None
