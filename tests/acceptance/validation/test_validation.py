"""The checks of `saf-gen validate`, at their small and full sizes."""

import numpy as np
import pytest

from saf_gen.acceptance.validation import all_validation_checks, choose_validation_checks
from saf_gen.acceptance.validation.runner import run_validation_checks
from saf_gen.camera import encoder


@pytest.mark.slow
def test_every_check_passes_at_its_small_size(tmp_path):
    """Tolerances follow from the statistics of the workloads; seeds are fixed."""
    verdicts = run_validation_checks(list(all_validation_checks().values()), tmp_path, quick=True)
    assert {v.name: v.reason or v.comparisons for v in verdicts if v.outcome not in ("passed", "skipped")} == {}
    assert {v.name for v in verdicts if v.outcome == "skipped"} <= {"referee_emva1288"}


@pytest.mark.slow
def test_half_the_variance_of_thresholds_in_the_product_is_found_by_name(tmp_path, monkeypatch):
    real = encoder._pixel_constants

    def quieter(*arguments, **options):
        constants = real(*arguments, **options)
        constants[2] *= np.float32(np.sqrt(0.5))
        return constants

    monkeypatch.setattr(encoder, "_pixel_constants", quieter)
    verdicts = run_validation_checks(choose_validation_checks(["noise"]), tmp_path, quick=True)
    failed = {v.name for v in verdicts if v.outcome == "failed"}
    assert failed == {"noise_photon_transfer", "noise_spectrum", "noise_independence"}


@pytest.mark.long
def test_every_check_passes_at_full_size(tmp_path, worker_processes):
    verdicts = run_validation_checks(choose_validation_checks([]), tmp_path)
    assert {v.name: v.reason or v.comparisons for v in verdicts if v.outcome not in ("passed", "skipped")} == {}
