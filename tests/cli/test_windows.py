"""On Windows, commands that nobody has tried there say so in a line, and nothing needs what only POSIX has."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import saf_gen
from saf_gen.cli import doctor
from saf_gen.core import child, cores

POSIX_MODULES = ("fcntl", "resource", "pwd", "grp", "termios")
POSIX_NAMES = {
    "os": ("fork", "killpg", "getuid", "geteuid", "sched_getaffinity", "sysconf", "memfd_create", "nice", "getpgid"),
    "signal": ("SIGKILL", "SIGHUP", "SIGALRM", "setitimer", "SIGUSR1", "SIGQUIT"),
    "select": ("poll",),
}
RUN = f"""
import os, select, signal, subprocess, sys
import concurrent.futures, multiprocessing.connection
import h5py, matplotlib, numba, numpy, rich.console, scipy.ndimage, typer
for name in {POSIX_MODULES}:
    sys.modules[name] = None
for module, names in {POSIX_NAMES}.items():
    for name in names:
        if hasattr(sys.modules[module], name):
            delattr(sys.modules[module], name)
from saf_gen.cli import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize(("command", "told"), [("scenes list", True), ("recipes list", True), ("inspect a.h5", False)])
def test_a_command_that_nobody_has_tried_on_windows_says_so_in_one_line(call, monkeypatch, tmp_path, command, told):
    monkeypatch.chdir(tmp_path)
    saf_gen.write_stream("a.h5", np.ones((64, 8, 8), np.uint8))
    assert call(*command.split())[2] == ""
    monkeypatch.setattr(cores, "IS_WINDOWS", True)
    code, _, err = call(*command.split())
    assert code == 0
    assert (err.count("\n"), "use WSL2" in err) == ((1, True) if told else (0, False))


def test_doctor_advises_wsl2_on_windows_alone(monkeypatch):
    assert cores.WINDOWS_ADVICE not in doctor.describe_machine()[1]
    monkeypatch.setattr(cores, "IS_WINDOWS", True)
    assert cores.WINDOWS_ADVICE in doctor.describe_machine()[1]


def test_a_child_that_died_is_described_without_the_signals_of_posix(monkeypatch):
    monkeypatch.delattr(child.signal, "SIGKILL")
    process = SimpleNamespace(wait=lambda _: None, poll=lambda: 3)
    assert child.Child._how_it_ended(SimpleNamespace(_process=process)) == "ended with exit code 3"


@pytest.mark.slow
def test_what_ci_runs_on_windows_needs_nothing_that_only_posix_has(tmp_path):
    """Names that Windows lacks are taken away, and the libraries keep those that they have bound already."""
    np.save(tmp_path / "frames.npy", np.random.default_rng(0).integers(0, 255, (8, 32, 32), "uint8"))
    for line in (
        "encode frames.npy --rate 1000 --linear --out stream.h5",
        "inspect stream.h5",
        "view stream.h5 --as tfp --window 100 --out view.png",
        "evaluate stream.h5 --method sd+argmax --out evaluation",
    ):
        ran = subprocess.run([sys.executable, "-c", RUN, *line.split()], cwd=tmp_path, capture_output=True, text=True)
        assert (ran.returncode, "Traceback" in ran.stderr) == (0, False), f"{line}: {ran.stderr}"
