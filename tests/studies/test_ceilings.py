"""How near noise-free peaks of measures come to the truth, from what recordings state."""

import json

import numpy as np
import pytest
from planted_sweeps import SHAPE, list_streams, make_spikes, make_truth
from refusals import refusal

from saf_gen.errors import BadInput
from saf_gen.stream.stream_writer import write_stream
from studies.ranking.ceilings import find_ceilings, find_peaks, main

PEAK, DOF = 400.0, 0.1


def write(folder, name, *, optima=None, sharpest=None):
    """A stream whose truth is at 400 / 799, with the peaks of measures, and of SD, so far from it."""
    at = PEAK / (SHAPE[0] - 1)
    curve = None if sharpest is None else 1 / (1 + ((np.linspace(0, 1, 81) - at - sharpest) / 0.1) ** 2)
    (folder / "test").mkdir(parents=True, exist_ok=True)
    write_stream(
        folder / "test" / f"{name}.h5",
        make_spikes(PEAK),
        focus_position=np.linspace(0, 1, SHAPE[0], dtype=np.float32),
        truth=make_truth(PEAK, dof=DOF, **({} if curve is None else {"sharpness": curve})),
        provenance={} if optima is None else {"optima": json.dumps(optima)},
    )


@pytest.mark.slow
def test_each_member_counts_once_and_sd_is_that_of_its_curve(tmp_path, capsys):
    write(tmp_path, "a", optima={"brenner": 0.02, "vollath_f4": -0.08}, sharpest=0.04)
    write(tmp_path, "b", optima={"brenner": 0.02, "vollath_f4": -0.08}, sharpest=0.04)  # another light
    write(tmp_path, "c", optima={"brenner": 0.0, "vollath_f4": 0.2}, sharpest=-0.06)
    dataset = list_streams(tmp_path, {"id": "a"}, {"id": "b", "light": "mains"}, {"id": "c", "variant": 1})
    found = {one.measure: one for one in find_ceilings(find_peaks(dataset))}
    assert list(found) == ["brenner", "sd", "vollath_f4"]
    assert found["brenner"].errors_dof == pytest.approx([0.2, 0.0])
    assert found["sd"].errors_dof == pytest.approx([0.4, -0.6], abs=0.02)
    assert [found["vollath_f4"].within(limit) for limit in (0.5, 1.0, 2.0)] == [0, 0.5, 1]
    assert main([str(dataset)]) == 0
    printed = capsys.readouterr().out
    assert "| `vollath_f4` | 2 | 0.0% | 50.0% | 1.400 | 2.00 |" in printed
    assert printed.splitlines()[-1].endswith("| 2 | 0 | 1 |")


def test_a_dataset_that_states_no_peaks_is_refused(tmp_path, capsys):
    write(tmp_path, "a")
    dataset = list_streams(tmp_path, {"id": "a"})
    assert isinstance(refusal(find_peaks, dataset), BadInput)
    assert main([str(dataset), "--split", "train"]) == 2
    assert "states where curves peak" in capsys.readouterr().err
