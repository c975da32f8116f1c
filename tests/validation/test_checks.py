"""The checks of `saf-gen validate`, at the small sizes, and whole."""

import pytest

from saf_gen.validation import all_checks, choose_checks
from saf_gen.validation.runner import run_checks


@pytest.mark.slow
def test_every_check_passes_at_its_small_size(tmp_path):
    """A tolerance follows from the statistics of its workload; seeds are fixed."""
    verdicts = run_checks(list(all_checks().values()), tmp_path, quick=True)
    assert {v.name: v.reason or v.comparisons for v in verdicts if v.outcome not in ("passed", "skipped")} == {}
    assert {v.name for v in verdicts if v.outcome == "skipped"} <= {"referee_emva1288"}


@pytest.mark.long
def test_every_check_passes_whole(tmp_path, worker_processes):
    verdicts = run_checks(choose_checks([]), tmp_path)
    assert {v.name: v.reason or v.comparisons for v in verdicts if v.outcome not in ("passed", "skipped")} == {}
