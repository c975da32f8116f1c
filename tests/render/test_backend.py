"""How the backend is chosen, without running it."""

import os
import re
import subprocess
import sys

import pytest
from refusals import refusal
from written_scenes import needs_llvm

from saf_gen.render import backend
from saf_gen.render.backend import BackendProbe, choose_backend

NEW, OLD, NONE = BackendProbe((19, 1, 7), False), BackendProbe((15, 0, 6), False), BackendProbe(None, False)
BLIND = BackendProbe((19, 1, 7), False, "Could not initialize OptiX!")


def test_cuda_comes_before_llvm_before_scalar():
    assert choose_backend("auto", BackendProbe((19, 1, 7), True)) == "cuda"
    assert choose_backend("auto", NEW) == "llvm"
    assert choose_backend("auto", BLIND) == "llvm"
    assert choose_backend("auto", OLD) == "scalar"
    assert choose_backend("auto", NONE) == "scalar"


@pytest.mark.parametrize(
    ("requested", "machine", "message"),
    [
        ("llvm", OLD, "LLVM 15.0.6 is too old: Mitsuba needs 17 or newer"),
        ("llvm", NONE, "no LLVM library was found"),
        ("cuda", NEW, "no NVIDIA card was found"),
        ("cuda", BLIND, "the card traces nothing: Could not initialize OptiX!"),
        ("lvm", NEW, "unknown variant 'lvm'"),
    ],
)
def test_a_backend_that_cannot_run_here_is_refused(requested, machine, message):
    error = refusal(choose_backend, requested, machine)
    assert message in error.problem
    assert ("libllvm19" in error.hint) == (requested == "llvm")
    assert ("NVIDIA_DRIVER_CAPABILITIES" in error.hint) == (requested == "cuda")
    assert error.nearest == ("llvm" if requested == "lvm" else "")


def test_scalar_runs_everywhere():
    assert choose_backend("scalar", NONE) == "scalar"


@pytest.mark.parametrize(
    ("script", "problem"),
    [
        ("print('traced')", ""),
        (
            "raise RuntimeError('a scene of\\ntwo lines:\\nCould not initialize OptiX!\\n')",
            "Could not initialize OptiX!",
        ),
        ("import os; os.abort()", "a ray ended the process (exit code -6)"),
        ("print('a ray met a triangle 0.0 away instead of 2')", "a ray met a triangle 0.0 away instead of 2"),
        ("import sys; sys.exit(3)", "a ray ended the process (exit code 3)"),
        ("print('traced'); raise SystemExit('later')", "later"),
        ("import time; time.sleep(60)", "no ray within 2 s"),
        ("raise ValueError('x' * 999)", "ValueError: " + 188 * "x"),
        ("import sys; sys.stderr.buffer.write(bytes([0xFF])); sys.exit(1)", "\ufffd"),
    ],
)
def test_a_card_is_judged_by_a_ray_of_another_process(monkeypatch, script, problem):
    monkeypatch.setattr(backend, "TRACE_TRIANGLE", script)
    monkeypatch.setattr(backend, "CARD_SECONDS", 2 if "sleep" in script else 60)
    assert backend._trace_triangle() == problem


@needs_llvm
@pytest.mark.slow
def test_the_triangle_is_met_where_it_is(monkeypatch):
    """The script for a card traces on the cores here; moved by 1 %, the triangle is not taken for the right one."""
    on_cores = backend.TRACE_TRIANGLE.replace("cuda_ad_mono", "llvm_ad_mono")
    moved = on_cores.replace("2.0", "2.02")
    for script, problem in ((on_cores, ""), (moved, "a ray met a triangle 2.0")):
        monkeypatch.setattr(backend, "TRACE_TRIANGLE", script)
        assert backend._trace_triangle()[:24] == problem


@pytest.mark.parametrize("problem", ["", "Could not initialize OptiX!"])
def test_a_card_is_judged_once_for_a_process_and_its_workers(monkeypatch, problem):
    monkeypatch.delenv(backend.CARD_VERDICT, raising=False)
    monkeypatch.setattr(backend.dr, "has_backend", lambda _: True)
    asked = []
    monkeypatch.setattr(backend, "_trace_triangle", lambda: asked.append(1) or problem)
    for _ in range(3):
        found = backend.probe_backends()
    assert (found.cuda, found.card_problem, len(asked)) == (not problem, problem, 1)
    assert os.environ[backend.CARD_VERDICT] == problem
    monkeypatch.setattr(backend.dr, "has_backend", lambda _: False)  # a worker on a machine without a card
    assert backend.probe_backends().cuda is False


@pytest.mark.parametrize(
    ("gib", "variant", "bands"), [(4, "cuda", 1), (8, "cuda", 1), (24, "cuda", 4), (140, "cuda", 8), (140, "llvm", 1)]
)
def test_a_card_traces_as_many_bands_at_once_as_its_memory_allows(monkeypatch, gib, variant, bands):
    class Driver:
        def __init__(self, name):
            assert "cuda" in name

        def cuDeviceTotalMem_v2(self, size, device):  # noqa: N802, the driver's name
            size._obj.value = gib << 30

    monkeypatch.setattr(backend.mi, "variant", lambda: backend.MITSUBA_VARIANTS[variant])
    monkeypatch.setattr(backend.ctypes, "CDLL", Driver)
    assert backend.bands_at_once() == bands


@pytest.mark.slow
def test_doctor_works_without_any_llvm_and_says_what_to_install(tmp_path):
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": str(tmp_path / "none.so"), "CUDA_VISIBLE_DEVICES": ""}
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
