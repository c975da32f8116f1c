"""Hostile methods cost their own rows alone: beside other methods, in both tracks, in one process and on Dask."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from dask_processes import scheduler_process, worker_processes
from landlock import has_landlock
from planted_sweeps import list_streams, make_spikes, make_truth

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.guests.host import Limits
from saf_gen.benchmark.records import record_to_json
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.optics.actuators import get_actuator
from saf_gen.stream.stream_writer import write_stream

FILE = Path(__file__).with_name("hostile_methods.py")
LIMITS = Limits(load_s=60, run_s=3, resident_bytes=600 << 20)
SHIPPED = {
    "recorded": ["sd+argmax:window=50", "sd_debiased+egs_code", "sd_tfi+argmax:window=80", "vollath_f4_n+peak_fit",
                 "tenengrad_n+argmax:window=50", "sd_code+sgfs_causal", "er_sumsq+sgfs_code:dt=20",
                 "cen+argmax:window=50"],
    "closed_loop": ["sd+hill_climb", "tenengrad_n+golden_section", "sd+sgfs_causal", "gradient_code_n+rule_based",
                    "sd+coarse_to_fine", "sd_debiased+egs_code", "tenengrad_n+argmax:window=20", "sd+fibonacci"],
}  # fmt: skip
FOREIGN = """
import numpy as np
from saf_gen.parts import Answer

def spread(counts):
    return float(np.ptp(counts))

def scan(view):
    firsts = range(0, view.frames - 49, 50)
    scores = [view.score(first, first + 50) for first in firsts]
    return Answer(firsts[int(np.argmax(scores))] + 24.5)
"""
FEW = ("exits_at_once", "reads_address_zero", "never_ends", "patches_a_rival", "asks_without_listening",
       "closes_all_descriptors")  # fmt: skip
COST = ("seconds", "machine", "reference_rate")


def load_hostile():
    spec = importlib.util.spec_from_file_location("hostile_methods", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    left_out = set() if has_landlock() else module.SHUT_IN
    return {name: reason for name, reason in module.HOSTILE.items() if name not in left_out}


HOSTILE = load_hostile()


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweeps")
    for name, peak in (("one", 120.0), ("two", 260.0)):
        path = folder / "test" / f"{name}.h5"
        path.parent.mkdir(exist_ok=True)
        lens = np.linspace(0, 1, 400, dtype=np.float32)
        write_stream(
            path, make_spikes(peak, shape=(400, 24, 32)), focus_position=lens, truth=make_truth(peak, frames=400)
        )
    return list_streams(folder, {"id": "one", "scene": "one"}, {"id": "two", "scene": "two"})


@pytest.fixture(scope="module", params=["here", pytest.param("one", marks=pytest.mark.long), "two"])
def cluster(request, tmp_path_factory):
    """Where sequences are evaluated: in this process, or on Dask by one or two processes that a nanny started."""
    if request.param == "here":
        yield None
        return
    folder = tmp_path_factory.mktemp("dask")
    with (
        scheduler_process(folder) as (_, address),
        worker_processes(folder, address, "--nworkers", {"one": "1", "two": "2"}[request.param]),
    ):
        yield address


@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    path = tmp_path_factory.mktemp("foreign") / "theirs.py"
    path.write_text(FOREIGN)
    return [f"{path}:spread+argmax:window=40", f"sd+{path}:scan"]


@pytest.mark.slow
@pytest.mark.daily(2)
@pytest.mark.parametrize("track", ["recorded", "closed_loop"])
@pytest.mark.parametrize(
    "names", [pytest.param(FEW, id="few"), pytest.param(tuple(HOSTILE), marks=pytest.mark.long, id="all")]
)
def test_hostile_methods_cost_their_own_rows_alone(sweeps, captured_dataset, cluster, foreign, track, names):
    how = {"draw": False, "check": False, "cluster": cluster, "limits": LIMITS}
    if track == "closed_loop":
        how |= {"protocol": ClosedLoopProtocol(get_actuator("voice_coil")), "scene_motion": "static"}
    dataset = sweeps if track == "recorded" else captured_dataset
    others = [*SHIPPED[track], *foreign]
    hostile = {f"sd+{FILE}:{name}": HOSTILE[name] for name in names}
    mixed = list(hostile)
    for number, method in enumerate(others):
        mixed.insert(number * 2, method)
    alone = evaluate(dataset, methods=others, **how)
    beside = evaluate(dataset, methods=mixed, **how)
    assert (alone.failures, beside.failures) == ((), ())
    assert {r.judgement.status for r in alone.records if r.who.method in foreign} == {"answered"}
    for method in others:
        assert rows(beside, method) == rows(alone, method)
    for method, reason in hostile.items():
        for record in beside.records:
            if record.who.method == method and reason:
                assert record.judgement.status == "failed"
                assert re.search(f"{reason}|within 3 s" if "MiB" in reason else reason, record.judgement.note), method
            elif record.who.method == method:
                assert record.judgement.status == "answered", (method, record.judgement.note)


def rows(evaluation, method):
    found = [record_to_json(record) for record in evaluation.records if record.who.method == method]
    assert found
    return [{key: value for key, value in record.items() if key not in COST} for record in found]
