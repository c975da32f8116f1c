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
RUN = """
import sys, traceback
from saf_gen.cli import main
for words in sys.argv[1:]:
    try:
        main(words.split())
    except SystemExit as ended:
        print(f"{ended.code} {words}", flush=True)
    except BaseException:
        print(f"{traceback.format_exc()} {words}", flush=True)
"""


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


PYTHON = """
import numpy
import saf_gen, saf_gen.cli, saf_gen.core.files, saf_gen.benchmark.evaluate, saf_gen.generate.run
from saf_gen.core.files import *
with saf_gen.open_stream('ds/test/one.h5') as stream:
    assert stream.counts(0, 20).sum() > 0
saf_gen.write_stream('new.h5', numpy.zeros((80, 8, 8), 'u1'), readout_hz=20_000)
with lock_folder(Path('locked')):
    check_file_system(Path())
assert len(saf_gen.SpikeWindows('ds', window=20)) > 0
"""
COMMANDS = (
    "--help",
    "verify ds",
    "inspect ds/test/one.h5",
    "view ds/test/one.h5 --out one.png",
    "score ds/test/one.h5 --measure sd --window 100 --out curve.csv",
    "evaluate ds --method sd+argmax --out judged",
    "cut ds/test/one.h5 --from 80 --to 160 --out part.h5",
    "recipes check quickstart",
    "generate quickstart --dry-run",
)


@pytest.mark.slow
def test_python_reads_writes_locks_and_trains(folder):
    run(folder, PYTHON)


@pytest.mark.slow
def test_commands_that_need_no_renderer_run(folder):
    """In one process, because starting it takes longer than most of them."""
    said = run(folder, RUN, *COMMANDS)
    assert [line for line in said.splitlines() if line.endswith(COMMANDS)] == [f"0 {words}" for words in COMMANDS]
