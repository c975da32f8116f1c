"""If memory is scarce, commands end with one line."""

import os
import resource
import subprocess
import sys

import pytest

from saf_gen.core.cores import check_address_space
from saf_gen.errors import BadInput


@pytest.fixture
def limited():
    """A function that limits the memory of this process until the end of the test."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    yield lambda size: resource.setrlimit(resource.RLIMIT_AS, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_AS, before)


def test_a_memory_limit_below_what_libraries_need_is_refused(limited):
    limited(1 << 40)
    check_address_space(1 << 30)
    with pytest.raises(BadInput, match=r"only 1,048,576 MiB of memory \(ulimit -v\); allowed: 2,097,152 MiB or more"):
        check_address_space(2 << 40)


@pytest.mark.slow
def test_a_command_under_such_a_limit_ends_at_once():
    """Without the check OpenBLAS waits for ever at 400 MiB, and a signal ends Mitsuba at 1 GB."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (700 << 20, 700 << 20))

    command = [sys.executable, "-m", "saf_gen", "sensors", "list"]
    ended = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit, env=os.environ, check=False)
    assert ended.returncode == 2
    assert ended.stderr.splitlines() == [ended.stderr.rstrip("\n")]
    assert "saf-gen: this process may use only 700 MiB of memory (ulimit -v); allowed: 1,024 MiB or" in ended.stderr


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "memory ran out"),
        (RuntimeError("can't start new thread"), "the system cannot start more threads and processes"),
    ],
)
def test_memory_that_runs_out_is_one_line(monkeypatch, call, error, message):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("saf_gen.camera.sensor_files.sensor_text", fail)
    code, _, err = call("sensors", "show", "ideal")
    (line,) = err.splitlines()
    assert code == 1
    assert line.startswith(f"saf-gen: {message}: finished work is kept")
