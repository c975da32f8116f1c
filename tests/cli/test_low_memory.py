"""Where memory is scarce a command ends with one line."""

import os
import resource
import subprocess
import sys

import pytest

from saf_gen.cli import main
from saf_gen.core.cores import check_address_space
from saf_gen.errors import BadInput


@pytest.fixture
def limited():
    """Limits of this process that a test may set, and that hold no longer than it."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    yield lambda size: resource.setrlimit(resource.RLIMIT_AS, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_AS, before)


def test_a_limit_below_what_libraries_need_is_told_before_they_wait_or_abort(limited):
    limited(1 << 40)
    check_address_space(1 << 30)
    with pytest.raises(BadInput, match=r"may take 1,048,576 MiB of memory \(ulimit -v\); allowed: 2,097,152 MiB"):
        check_address_space(2 << 40)


def test_a_command_under_such_a_limit_ends_at_once():
    """400 MiB made OpenBLAS wait for ever; 1 GB ended Mitsuba by a signal."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (700 << 20, 700 << 20))

    command = [sys.executable, "-m", "saf_gen", "sensors", "list"]
    ended = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit, env=os.environ, check=False)
    assert ended.returncode == 2
    assert ended.stderr.splitlines() == [ended.stderr.rstrip("\n")]
    assert "saf-gen: this process may take 700 MiB of memory (ulimit -v); allowed: 1,024 MiB and more" in ended.stderr


@pytest.mark.parametrize(
    ("error", "told"),
    [(MemoryError(), "memory ran out"), (RuntimeError("can't start new thread"), "the system starts no more threads")],
)
def test_memory_that_runs_out_is_one_line(monkeypatch, capsys, error, told):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("saf_gen.camera.sensor_files.read_sensor_file_text", fail)
    with pytest.raises(SystemExit) as ended:
        main(["sensors", "show", "ideal"])
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"saf-gen: {told}: what was done is kept")
