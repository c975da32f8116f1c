"""How the backend is chosen, without running it."""

import os
import re
import subprocess
import sys

import pytest
from refusals import refusal

from saf_gen.render.backend import BackendProbe, choose_backend

NEW, OLD, NONE = BackendProbe((19, 1, 7), False), BackendProbe((15, 0, 6), False), BackendProbe(None, False)


def test_cuda_comes_before_llvm_before_scalar():
    assert choose_backend("auto", BackendProbe((19, 1, 7), True)) == "cuda"
    assert choose_backend("auto", NEW) == "llvm"
    assert choose_backend("auto", OLD) == "scalar"
    assert choose_backend("auto", NONE) == "scalar"


@pytest.mark.parametrize(
    ("requested", "machine", "message"),
    [
        ("llvm", OLD, "LLVM 15.0.6 is too old: Mitsuba needs 17 or newer"),
        ("llvm", NONE, "no LLVM library was found"),
        ("cuda", NEW, "no NVIDIA card"),
        ("lvm", NEW, "unknown variant 'lvm'"),
    ],
)
def test_a_backend_that_cannot_run_here_is_refused(requested, machine, message):
    error = refusal(choose_backend, requested, machine)
    assert message in error.problem
    assert ("libllvm19" in error.hint) == (requested == "llvm")
    assert error.nearest == ("llvm" if requested == "lvm" else "")


def test_scalar_runs_everywhere():
    assert choose_backend("scalar", NONE) == "scalar"


@pytest.mark.slow
def test_doctor_works_without_any_llvm_and_says_what_to_install(tmp_path):
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": str(tmp_path / "none.so")}
    run = subprocess.run(
        [sys.executable, "-m", "saf_gen", "doctor"], env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert "no LLVM library was found" in run.stdout
    assert "to be faster: install LLVM 17 or newer" in run.stdout
    assert re.search(r"variant +scalar\b", run.stdout)


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", [["generate", "quickstart"], ["scenes", "preview", "fan"], ["scenes", "check", "fan"]]
)
def test_a_renderer_that_lacks_a_library_is_told_in_one_line(tmp_path, command):
    """As on a system without libatomic, where Dr.Jit 1.5 fails with a NameError while it reports what is missing."""
    broken = tmp_path / "packages" / "drjit"
    broken.mkdir(parents=True)
    lacks = "ImportError('libatomic.so.1: cannot open shared object file')"
    (broken / "__init__.py").write_text(f"try:\n    raise {lacks}\nexcept ImportError:\n    _drjit_ext\n")
    paths = [str(broken.parent), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    saf_gen = [sys.executable, "-m", "saf_gen", *command]
    run = subprocess.run(saf_gen, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 2, run.stdout
    assert "libatomic.so.1" in run.stderr
    assert "apt install libatomic1" in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.slow
def test_threads_that_wait_for_work_sleep():
    """As OpenMP itself reports in another process; numba may use another kind of threads."""
    code = (
        "import numba, numpy, saf_gen.render.shading_kernels as kernels\n"
        "kernels.cell_keys(numpy.ones(9, 'u4'), *numpy.ones((5, 9), 'f4'))\n"
        "print(numba.threading_layer())"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OMP_WAIT_POLICY"} | {"OMP_DISPLAY_ENV": "TRUE"}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    if run.stdout.strip() != "omp":
        pytest.skip(f"numba's threads are {run.stdout.strip()}")
    assert "OMP_WAIT_POLICY = 'PASSIVE'" in run.stderr.upper()
