"""Which Mitsuba to run is decided without running it."""

import os
import subprocess
import sys

import pytest

from saf_gen.errors import BadInput
from saf_gen.render.backend import BackendProbe, choose_backend

NEW, OLD, NONE = BackendProbe((19, 1, 7), False), BackendProbe((15, 0, 6), False), BackendProbe(None, False)


def test_cuda_comes_before_llvm_before_scalar():
    assert choose_backend("auto", BackendProbe((19, 1, 7), True)) == "cuda"
    assert choose_backend("auto", NEW) == "llvm"
    assert choose_backend("auto", OLD) == "scalar"
    assert choose_backend("auto", NONE) == "scalar"


def test_llvm_15_is_refused_in_plain_words():
    with pytest.raises(
        BadInput, match=r"LLVM 15.0.6 is too old: Mitsuba needs 17 or newer and would abort; inst"
    ):
        choose_backend("llvm", OLD)


def test_no_llvm_is_told_with_what_to_install():
    with pytest.raises(
        BadInput, match=r"no LLVM library was found; install LLVM 17 or newer \(.*libllvm19\)"
    ):
        choose_backend("llvm", NONE)


def test_cuda_without_a_card_is_refused():
    with pytest.raises(BadInput, match="no NVIDIA card"):
        choose_backend("cuda", NEW)


def test_an_unknown_variant_is_told_with_the_nearest():
    with pytest.raises(BadInput, match=r"unknown variant 'lvm'; .*did you mean 'llvm'\?"):
        choose_backend("lvm", NEW)


def test_scalar_runs_everywhere():
    assert choose_backend("scalar", NONE) == "scalar"


def test_doctor_works_without_any_llvm_and_says_what_to_install(tmp_path):
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": str(tmp_path / "none.so")}
    run = subprocess.run(
        [sys.executable, "-m", "saf_gen", "doctor"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "no LLVM library was found" in run.stdout
    assert "to be faster: install LLVM 17 or newer" in run.stdout
    assert "│ scalar" in run.stdout
