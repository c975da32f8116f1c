"""Children and what they start: they send and receive within limits, end as a whole, and use only what they may."""

import os
import subprocess
import sys
import time
from pathlib import Path

import child_programs
import numpy as np
import pytest

from saf_gen.core.child import Child, ChildLost, Reach, SharedMemory

PROC_LISTS_CHILDREN = Path("/proc/thread-self/children").exists()


@pytest.fixture
def start():
    """Return a function that starts one of child_programs, which is ended after the test."""
    started = []

    def begin(name, **options):
        started.append(Child(f"child_programs:{name}", **{"max_bytes": 1 << 20} | options))
        return started[-1]

    yield begin
    for child in started:
        child.close()


def receive(child, seconds=30.0):
    message = child.receive(seconds)
    assert message is not None
    return message.decode()


def is_gone(process, seconds=10.0):
    deadline = time.monotonic() + seconds
    while Path(f"/proc/{process}").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    return not Path(f"/proc/{process}").exists()


def test_messages_of_any_length_go_and_come(start):
    child = start("echoes", max_bytes=1 << 23)
    for size in (1, 65_536, 5_000_000):
        child.send(b"x" * size)
        assert receive(child) == "x" * size
    child.let_end()
    with pytest.raises(ChildLost, match="^ended with exit code 0$"):
        child.receive(30)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("sends_too_much", "^sent a message of 1048577 bytes"),
        ("sends_nothing", "^sent a message of 0 bytes"),
        ("exits", "^ended with exit code 7"),
        ("kills_itself", r"^was ended by signal 9 \(SIGKILL"),
        ("kills_its_group", r"^was ended by signal 15 \(SIGTERM\)"),
        ("closes_its_line", "^closed its line"),
        ("leaves_its_line_to_a_daemon", "^ended with exit code 0"),
    ],
)
def test_a_child_that_is_lost_says_how(start, name, says):
    child = start(name)
    with pytest.raises(ChildLost, match=says):
        child.receive(30)


def test_half_a_message_is_none_within_the_limit(start):
    child = start("sends_half")
    began = time.monotonic()
    assert child.receive(3.0) is None
    assert time.monotonic() - began < 10


def test_a_child_that_does_not_read_is_lost_within_the_limit(start):
    child = start("sleeps")
    with pytest.raises(ChildLost, match="does not read"):
        child.send(b"x" * (1 << 20), seconds=0.5)


def test_what_it_prints_last_is_still_told(start):
    said = []
    child = start("prints_and_exits", on_output=said.append)
    with pytest.raises(ChildLost):
        child.receive(30)
    child.close()
    assert b"".join(said).decode().split() == ["by", "print", "by", "write"]


@pytest.mark.skipif(not PROC_LISTS_CHILDREN, reason="the system does not list children")
@pytest.mark.parametrize("name", ["leaves_daemons", "leaves_daemons_without_an_environment", "hops"])
def test_nothing_that_a_child_started_outlives_it(start, name):
    child = start(name)
    processes = list(map(int, receive(child).split()))
    assert len(processes) == 3
    child.close()
    assert all(map(is_gone, processes))


@pytest.mark.skipif(not PROC_LISTS_CHILDREN, reason="the system does not list children")
def test_nothing_outlives_a_parent_that_is_killed(tmp_path):
    (tmp_path / "own" / "work").mkdir(parents=True)
    code = (
        "import os, signal; from pathlib import Path; from saf_gen.core.child import Child\n"
        f"child = Child('child_programs:leaves_daemons', max_bytes=1000, folder=Path({str(tmp_path / 'own')!r}))\n"
        "print(child.receive(30).decode(), flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(child_programs.__file__).parent), *sys.path])}
    ran = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert all(map(is_gone, ran.stdout.split())), ran.stderr
    assert len(ran.stdout.split()) == 3
    deadline = time.monotonic() + 10
    while (tmp_path / "own").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not (tmp_path / "own").exists()


@pytest.mark.slow
@pytest.mark.skipif(not PROC_LISTS_CHILDREN, reason="the system does not list children")
@pytest.mark.parametrize("name", ["holds_memory_in_a_child_of_a_thread", "holds_files_in_memory"])
def test_the_memory_of_all_that_a_child_started_is_counted(start, name):
    child = start(name)
    assert receive(child) == "holds"
    assert 280 << 20 < child.resident_bytes() < 600 << 20


def test_a_child_that_lengthens_the_memory_does_not_keep_its_parent_from_writing(start, tmp_path):
    memory = SharedMemory.create(tmp_path)
    child = start("lengthens_the_memory", memory=memory)
    child.send(str(memory.descriptor).encode())
    assert receive(child) in ("PermissionError", "")  # seals were refused
    image = np.arange(100_000.0)
    assert memory.write(image) == {"shape": [100_000], "dtype": "<f8"}
    memory.close()


def landlock_of(child):
    receive(child)
    return child.landlock()


@pytest.fixture
def shut_in(start, tmp_path):
    """A child that reads Python, tests and a folder, and writes in another; skipped where nothing shuts it in."""
    for name in ("read", "write", "secret"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(name)
    (tmp_path / "read" / "link").symlink_to(tmp_path / "secret" / "file")
    python = [sys.prefix, sys.base_prefix, "/usr", "/lib", "/lib64", "/etc", "/proc", *filter(os.path.exists, sys.path)]
    readable = [str(Path(path).resolve()) for path in [*python, tmp_path / "read"]]
    child = start("tries", reach=Reach(readable, [str(tmp_path)], [str(tmp_path / "write"), "/dev/null"]))
    if landlock_of(child) < 1:
        pytest.skip("the system has no Landlock")
    return child


@pytest.mark.parametrize(
    ("attempt", "outcome"),
    [
        ("open('{}/read/file').read()", "'read'"),
        ("open('{}/read/link').read()", "PermissionError"),
        ("open('{}/secret/file').read()", "PermissionError"),
        ("subprocess.run(['cat', '{}/secret/file'], capture_output=True).stdout", "b''"),
        ("sorted(os.listdir('{}'))", "['read', 'secret', 'write']"),
        ("open('{}/write/new', 'w').write('a')", "1"),
        ("open('{}/read/new', 'w').write('a')", "PermissionError"),
        ("os.truncate('{}/secret/file', 0)", "PermissionError"),
        ("os.kill({parent}, 0)", "PermissionError"),
        ("os.kill(os.getppid(), 0)", "PermissionError"),
        ("open('/proc/{parent}/environ').read()", "PermissionError"),
        ("open('/proc/{parent}/mem', 'rb')", "PermissionError"),
        ("open('/proc/{parent}/fd/2')", "PermissionError"),
        ("os.readlink('/proc/{parent}/fd/2')", "PermissionError"),
        ("open(f'/proc/{{os.getppid()}}/environ').read()", "PermissionError"),
        ("socket.create_connection(('127.0.0.1', 9))", "PermissionError"),
    ],
)
def test_a_child_that_is_shut_in_uses_only_what_it_may(shut_in, tmp_path, attempt, outcome):
    shut_in.send(attempt.replace("{}", str(tmp_path)).format(parent=os.getpid()).encode())
    assert receive(shut_in) == outcome


def test_a_child_that_may_use_everything_is_not_shut_in(start):
    assert landlock_of(start("tries")) == 0
