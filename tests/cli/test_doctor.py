"""`saf-gen doctor`: the description of the machine, and a self-check that finds what computes wrongly."""

import json
import os
import sys

import numpy as np
import pytest

from saf_gen.camera import encoder
from saf_gen.cli import doctor
from saf_gen.core import cores
from saf_gen.optics import ImageDistanceDrive


def test_a_machine_without_a_renderer_is_told_what_to_install(monkeypatch):
    for name in [m for m in sys.modules if m.startswith("saf_gen.render")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    described, advice = doctor.describe_machine()
    assert described["variant"].startswith("none: rendering needs the package mitsuba; ")
    assert advice == ["to render: pip install 'saf-gen[render]'"]
    passed, said = doctor.check_blur()
    assert passed
    assert "render" not in said


@pytest.mark.slow
def test_half_the_threshold_noise_fails_by_intervals_and_by_spikes(monkeypatch):
    real = encoder._pixel_constants

    def quieter(*arguments, **options):
        constants = real(*arguments, **options)
        constants[2] *= np.float32(np.sqrt(0.5))
        return constants

    monkeypatch.setattr(encoder, "_pixel_constants", quieter)
    assert not doctor.check_encoder()[0]
    assert not doctor.check_spikes()[0]


def test_a_drive_with_another_law_of_blur_fails(monkeypatch):
    real = ImageDistanceDrive.blur_diameter
    monkeypatch.setattr(ImageDistanceDrive, "blur_diameter", lambda *at: 1.001 * real(*at))
    monkeypatch.setattr(doctor, "RENDERER", ("a_package_that_nobody_has",))
    assert not doctor.check_blur()[0]


@pytest.mark.parametrize("as_json", [False, True])
def test_a_check_that_fails_or_breaks_is_a_line_and_exit_code_1(as_json, call, monkeypatch):
    def broken():
        raise RuntimeError("no kernel")

    monkeypatch.setattr(doctor, "check_blur", lambda: (True, "alike"))
    monkeypatch.setattr(doctor, "check_encoder", broken)
    monkeypatch.setattr(doctor, "check_spikes", lambda: (False, "apart"))
    code, shown, _ = call("doctor", *(["--json"] if as_json else []))
    assert code == 1
    if as_json:
        found = json.loads(shown)
        assert found["edge out of focus"] == "ok: alike"
        assert found["spikes"] == "failed: apart"
    else:
        assert shown.splitlines()[-3:] == [
            "ok: edge out of focus: alike",
            "failed: rate and intervals: RuntimeError: no kernel",
            "failed: spikes: apart",
        ]
    monkeypatch.setattr(doctor, "check_encoder", lambda: (True, "alike"))
    monkeypatch.setattr(doctor, "check_spikes", lambda: (True, "alike"))
    assert call("doctor")[0] == 0


@pytest.mark.parametrize(
    ("slurm", "line"),
    [
        ("1", "1 usable of {}, by SLURM_CPUS_PER_TASK; affinity: 3"),
        ("3", "3 usable of {}, by affinity, SLURM_CPUS_PER_TASK"),
        ("100", "3 usable of {}, by affinity; SLURM_CPUS_PER_TASK: 100"),
        ("", "3 usable of {}, by affinity"),
    ],
)
def test_the_line_on_cores_says_which_limit_counts(monkeypatch, slurm, line):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2}, raising=False)
    monkeypatch.setattr(cores, "cgroup_quota", lambda root: None)
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", slurm)
    assert doctor.describe_machine()[0]["cores"] == line.format(os.cpu_count())
