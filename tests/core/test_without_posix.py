"""The core works where Python lacks what only POSIX has, as on Windows: reading, importing, evaluating, viewing."""

import os
import subprocess
import sys

import numpy as np
import pytest
from planted_sweeps import list_streams, write_sweep

HIDE = """
import os, select, signal, sys
for name in ("fcntl", "resource", "pwd", "grp", "termios"):
    sys.modules[name] = None  # so that importing it raises ImportError
for module, names in {os: ("sched_getaffinity", "getuid", "killpg", "sysconf", "fork"), select: ("poll",),
                      signal: ("SIGHUP", "pthread_sigmask")}.items():
    for name in names:
        delattr(module, name)
"""
RUN = "from saf_gen.cli import main\nmain()\n"


def run(folder, code, *words):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", HIDE + code, *map(str, words)]
    ran = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("windows")
    write_sweep(folder / "ds/test/one.h5", 300.0)
    list_streams(folder / "ds", {"id": "one", "split": "test", "scene": "board"})
    (np.random.default_rng(5).random((400, 250, 400)) < 0.2).astype(np.uint8).tofile(folder / "dense.raw")
    return folder


@pytest.mark.parametrize(
    "code",
    [
        "import saf_gen, saf_gen.cli, saf_gen.core.files, saf_gen.benchmark.evaluate, saf_gen.generate.run",
        "import saf_gen; s = saf_gen.open_stream('ds/test/one.h5'); print(s.counts(0, 20).sum()); s.close()",
        "import saf_gen, numpy; saf_gen.write_stream('new.h5', numpy.zeros((80, 8, 8), 'u1'), readout_hz=20_000)",
        "from saf_gen.core.files import *\nwith lock_folder(Path('locked')): check_file_system(Path())",
        "import saf_gen; w = saf_gen.SpikeWindows('ds', window=20); print(len(w))",
    ],
)
def test_python_reads_writes_locks_and_trains(folder, code):
    run(folder, code)


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "--help",
        "verify ds",
        "inspect ds/test/one.h5",
        "view ds/test/one.h5 --out one.png",
        "score ds/test/one.h5 --measure sd --window 100 --out curve.csv",
        "evaluate ds --method sd+argmax --out judged",
        "cut ds/test/one.h5 --from 80 --to 160 --out part.h5",
        "recipes check quickstart",
        "generate quickstart --dry-run",
    ],
)
def test_commands_that_need_no_renderer_run(folder, words):
    run(folder, RUN, *words.split())
