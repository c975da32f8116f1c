"""Recordings say whether a 1 is a spike or a photon, and measures that correct for spikes refuse photons."""

import json

import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.benchmark.evaluate import evaluate, score_blocks
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

FLAT = np.random.default_rng(1).random((400, 40, 64)) < 0.3
"""Photons of a flat field, which has no contrast: detections of different frames are independent."""
NEEDS_SPIKES = "corrects for the noise of spikes | single photons | such as sd"


@pytest.fixture
def photons(tmp_path, call):
    """An imported recording of single photons."""
    np.save(tmp_path / "a.npy", FLAT)
    options = ("--axes", "TYX", "--kind", "photons", "--out", tmp_path / "a.h5")
    code, out, err = call("import", tmp_path / "a.npy", *options)
    assert (code, err) == (0, "")
    assert "photons read as an array" in out
    return tmp_path / "a.h5"


def test_a_recording_keeps_its_kind_when_it_is_cut_and_shows_it(tmp_path, call, photons):
    assert call("cut", photons, "--to", 200, "--out", tmp_path / "part.h5")[0] == 0
    for path in (photons, tmp_path / "part.h5"):
        with open_stream(path) as stream:
            assert (stream.metadata.kind, stream.counted) == ("photons", "photons")
            stream.verify()
        assert json.loads(call("inspect", path, "--json")[1])["kind"] == "photons"


def test_an_export_says_that_its_reader_must_be_told_the_kind(tmp_path, call, photons):
    raw, back = tmp_path / "a.dat", tmp_path / "back.h5"
    code, _, err = call("export", photons, "--out", raw, "--layout", "dense")
    assert code == 0
    assert "cannot say that it holds photons: saf-gen import FILE --kind photons" in err
    for options, kind in (((), "spikes"), (("--kind", "photons"), "photons")):
        assert call("import", raw, "--size", "64x40", "--bits", "lsb", "--out", back, *options)[0] == 0
        with open_stream(back) as stream:
            assert stream.metadata.kind == kind
            assert np.array_equal(stream.frames(0, 400), FLAT)


@pytest.mark.parametrize("measure", ["sd_debiased", "sd_calibrated", "structure_calibrated"])
def test_measures_that_correct_for_spikes_refuse_photons(tmp_path, call, photons, measure):
    with open_stream(photons) as stream:
        assert_says(refusal(score_blocks, stream, measure, window=100), NEEDS_SPIKES)
        assert_says(refusal(score_blocks, stream, get_measure(measure), window=100), measure)
    assert_says(refusal(evaluate, photons, methods=[f"{measure}+argmax"]), NEEDS_SPIKES)
    for command in (
        ("score", photons, "--measure", measure, "--window", 100),
        ("view", photons, "--measure", measure, "--out", tmp_path / "a.png"),
    ):
        code, _, err = call(*command)
        assert (code, "corrects for the noise of spikes" in err, err.count("\n")) == (2, True, 1), err
    assert not (tmp_path / "a.png").exists()


def test_a_dataset_with_one_recording_of_photons_refuses_them_too(tmp_path, call, photons):
    write_stream(tmp_path / "set/a-lamp-00.h5", FLAT)
    photons.rename(tmp_path / "set/b-lamp-00.h5")
    assert call("dataset", "index", tmp_path / "set")[0] == 0
    code, _, err = call("evaluate", tmp_path / "set", "--method", "sd_debiased+argmax")
    assert (code, "corrects for the noise of spikes" in err) == (2, True), err


@pytest.mark.slow
def test_other_measures_take_photons(tmp_path, call, photons):
    assert call("score", photons, "--measure", "sd", "--window", 100)[0] == 0
    assert call("view", photons, "--as", "spikes", "--out", tmp_path / "a.png")[0] == 0


def test_the_correction_for_spikes_would_be_taken_for_contrast(tmp_path):
    """A flat field of photons that claims to be one of spikes: 1/12 over the product of the mean counts of halves."""
    write_stream(tmp_path / "a.h5", FLAT)
    with open_stream(tmp_path / "a.h5") as stream:
        scores = score_blocks(stream, "sd_debiased", window=10)[1]
    assert scores.mean() == pytest.approx(1 / 12 / 1.5**2, rel=0.15)  # three standard errors of 40 windows


def test_a_kind_is_not_part_of_the_content_and_an_unknown_one_is_refused(tmp_path, call):
    digests = {write_stream(tmp_path / f"{kind}.h5", FLAT, kind=kind) for kind in ("spikes", "photons")}
    assert digests == {write_stream(tmp_path / "a.h5", FLAT)}
    assert_says(refusal(write_stream, tmp_path / "b.h5", FLAT, kind="photon"), "kind of recording | did you mean")
    assert_says(refusal(write_stream, tmp_path / "b.h5", FLAT, provenance={"kind": "photons"}), "use the field kind")
    np.save(tmp_path / "a.npy", FLAT)
    options = ("--axes", "TYX", "--kind", "events", "--out", tmp_path / "c.h5")
    code, _, err = call("import", tmp_path / "a.npy", *options)
    assert (code, "unknown kind of recording 'events'; allowed: photons, spikes" in err) == (2, True), err
    assert not (tmp_path / "c.h5").exists()
