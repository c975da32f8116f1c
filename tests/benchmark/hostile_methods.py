"""Methods that are hostile or clumsy, and what their rows must say; the file is loaded as a stranger's.

Each search of HOSTILE is run alone by tests/benchmark/test_guests.py, and all of them beside other methods by
tests/benchmark/test_guests_beside_others.py. The reason is a regular expression for the note of the failed run, or ""
if the method must answer like any other.
"""

import atexit
import ctypes
import fcntl
import gc
import json
import mmap
import os
import re
import resource
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from functools import wraps
from pathlib import Path

import numpy as np

from saf_gen.parts import Answer

HOSTILE = {}
FIRST = 7.0  # the answer of all that answer


SHUT_IN = set()  # the names of those that fail for Landlock alone


def says(reason, *, shut_in=False):
    def note(function):
        if shut_in:
            SHUT_IN.add(function.__name__)

        @wraps(function)
        def search(view):
            answer = function(view)
            return Answer(FIRST) if answer is None else answer

        HOSTILE[function.__name__] = reason
        return search

    return note


@says("ended with exit code 0")
def exits_at_once(view):
    os._exit(0)


@says("ended with exit code 3")
def exits_after_a_score(view):
    view.score(0, 100)
    os._exit(3)


@says(r"CodeStopped: its code called exit\('bye'\)")
def raises_system_exit(view):
    raise SystemExit("bye")


@says("CodeStopped: its code raised GeneratorExit")
def raises_generator_exit(view):
    raise GeneratorExit


@says("KeyboardInterrupt")
def raises_keyboard_interrupt(view):
    raise KeyboardInterrupt


@says("BadPlan: it is late")
def raises_an_error_of_its_own(view):
    class BadPlan(Exception):
        pass

    raise BadPlan("it is late")


@says("SIGSEGV")
def reads_address_zero(view):
    ctypes.string_at(0)


@says("SIGABRT")
def aborts(view):
    os.abort()


@says("SIGKILL")
def kills_itself(view):
    os.kill(os.getpid(), signal.SIGKILL)


@says("ended with exit code|closed its line|OSError|its process sent")
def closes_all_descriptors(view):
    os.closerange(0, 4096)
    view.score(0, 100)


@says("did not answer within|RecursionError|ended with exit code")
def lowers_the_recursion_limit(view):
    sys.setrecursionlimit(20)
    view.score(0, 100)


@says("")
def changes_the_folder(view):
    os.chdir("/")


@says("")
def forks_and_returns_twice(view):
    os.fork()


@says("ended with exit code 0|closed its line")
def forks_and_lets_the_copy_answer(view):
    if os.fork():
        os._exit(0)


@says("did not answer within")
def never_ends(view):
    while True:
        pass


@says("did not answer within")
def sleeps(view):
    time.sleep(1000)


@says("did not answer within|asked")
def scores_for_ever(view):
    while True:
        view.score(0, 100)


@says("its trace has 2,000,000 entries")
def gives_a_long_trace(view):
    return Answer(FIRST, (1.0,) * 2_000_000)


@says("its note has 5,000,000 characters")
def gives_a_long_note(view):
    return Answer(FIRST, (), "x" * 5_000_000)


@says("MiB of memory")
def uses_all_memory(view):
    kept = []
    while True:
        kept.append(np.ones(1 << 22))


@says("MiB of memory")
def uses_memory_in_a_child(view):
    code = "x = bytearray(1 << 30)\nimport time\ntime.sleep(60)"
    subprocess.run([sys.executable, "-c", code])


@says("")
def leaves_a_child_behind(view):
    subprocess.Popen(["sleep", "1000"], start_new_session=True)


@says("")
def prints_much(view):
    for _ in range(200):
        os.write(1, b"x" * 100_000)


@says("its process sent|closed its line|did not answer")
def writes_nonsense_to_every_descriptor(view):
    for descriptor in range(3, 64):
        with suppress(OSError):
            os.write(descriptor, b"\xff" * 64)


@says("")
def shortens_the_shared_memory(view):
    for descriptor in range(3, 64):
        with suppress(OSError):
            os.ftruncate(descriptor, 0)
    view.score(0, 100)


@says("TypeError|ValueError|OverflowError|BadInput|it answers")
def answers_with_a_huge_number(view):
    return Answer(10**5000)


@says("it answers frame nan")
def answers_with_nan(view):
    return Answer(float("nan"))


@says("it answers with str")
def answers_with_text(view):
    return "frame 7"


@says("it answers with a position")
def answers_with_a_position(view):
    return Answer(position=0.5)


@says("BadInput: ")
def asks_for_windows_that_do_not_exist(view):
    view.score(-5, 10**30)


@says("TypeError|BadInput|AttributeError|its process sent")
def asks_for_windows_of_text(view):
    view.score("a", "b")


@says("BadInput: the lens (of a recording )?cannot be moved")
def moves_the_lens_of_a_recording(view):
    view.move(0.5)


@says("")
def forgets_this_package(view):
    for name in [name for name in sys.modules if name.startswith("saf_gen")]:
        del sys.modules[name]


@says("")
def closes_its_streams(view):
    sys.stdout.close()
    sys.stderr.close()
    sys.stdin.close()


@says("")
def empties_its_environment(view):
    os.environ.clear()


@says("")
def leaves_a_thread_that_spins(view):
    def spin():
        while True:
            time.sleep(0.001)

    threading.Thread(target=spin).start()


@says("")
def registers_an_exit_that_blocks(view):
    atexit.register(time.sleep, 1000)


@says("")
def ignores_signals(view):
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


@says("SIGALRM")
def sets_an_alarm(view):
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    time.sleep(10)


@says("")
def allows_itself_no_files(view):
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))


@says("")
def deletes_its_folder(view):
    with suppress(OSError):  # it is gone at the next sequence
        subprocess.run(["rm", "-rf", Path.cwd()])


@says("OSError|SIGXFSZ")
def fills_the_disk(view):
    with Path("large").open("wb") as file:
        file.truncate(1 << 40)


@says("")
def patches_the_comparison(view):
    from saf_gen.benchmark import judgement
    from saf_gen.benchmark.view import restricted_view

    judgement.judge = lambda *_, **__: None
    restricted_view.MeteredScorer.windows = 0
    for found in gc.get_objects():
        if type(found).__name__ == "MeteredScorer":
            found.windows = -5


@says("")
def writes_to_what_it_sees(view):
    counts = view.counts(0, 100)
    try:
        counts[:] = 0
    except ValueError:
        return
    raise AssertionError


@says("NoteBomb|TypeError|its note")
def answers_with_traps(view):
    class NoteBomb(str):
        def splitlines(self, *_):
            raise TypeError("NoteBomb")

    return Answer(FIRST, (), NoteBomb("x"))


@says("")
def patches_a_rival(view):
    for name, module in list(sys.modules.items()):
        if name.startswith("saf_gen.plugins.measures."):
            for found in vars(module).values():
                if isinstance(found, type) and found.__module__ == name:
                    found.__call__ = lambda *_, **__: 0.0


@says("")
def patches_every_truth(view):
    from saf_gen.stream import metadata

    metadata.Truth.__init__ = lambda self, *_, **__: None
    for found in gc.get_objects():
        if type(found).__name__ == "Truth":
            object.__setattr__(found, "position", 0.5)


@says("")
def walks_from_its_view_to_the_truth(view):
    walked, seen = [view], set()
    while walked and len(seen) < 5_000:
        found = walked.pop()
        if id(found) not in seen:
            seen.add(id(found))
            walked += [one for one in gc.get_referents(found) if not isinstance(one, type | type(sys))]
            if type(found).__name__ in ("SpikeStream", "Truth", "File", "RunningCamera", "RecordingView"):
                return Answer(99.0, note=type(found).__name__)


@says("")
def reads_what_its_process_holds(view):
    for descriptor in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if (target := str(descriptor.readlink())).endswith((".h5", ".exr", ".json", ".jsonl")):
                return Answer(99.0, note=target)


@says("")
def looks_into_the_temporary_folder(view):
    for path in Path(tempfile.gettempdir()).rglob("*"):
        return Answer(99.0, note=str(path))


@says("SIGKILL")
def kills_its_group(view):
    os.killpg(0, signal.SIGKILL)


@says("did not answer within")
def stops_itself(view):
    os.kill(os.getpid(), signal.SIGSTOP)


@says("did not answer within")
def holds_the_interpreter(view):
    re.match(r"(a+)+$", "a" * 64 + "b")


@says("RecursionError|SIGSEGV")
def recurses_for_ever(view):
    def again():
        return again()

    again()


@says("MemoryError")
def runs_out_of_memory_in_python(view):
    raise MemoryError


@says("EOFError")
def asks_the_user(view):
    input("which frame? ")


@says("")
def starts_many_threads(view):
    for _ in range(100):
        threading.Thread(target=time.sleep, args=(1000,), daemon=True).start()


@says("")
def blocks_all_signals(view):
    signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 32))


@says("")
def takes_the_last_core_at_the_lowest_rank(view):
    os.nice(19)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


@says("")
def leaves_a_daemon(view):
    code = "import os, time\nif not os.fork():\n    os.setsid()\n    time.sleep(1000)"
    subprocess.run([sys.executable, "-c", code], close_fds=False)


@says("ended with exit code 5")
def exits_from_a_thread(view):
    threading.Thread(target=os._exit, args=(5,)).start()
    time.sleep(10)


@says("BadInput: ")
def names_a_measure_that_does_not_exist(view):
    view.score(0, 100, "sharpest")


@says("BadInput: .* cannot be loaded")
def names_a_measure_in_a_file_that_does_not_exist(view):
    view.score(0, 100, "/nowhere/mine.py:mine")


@says("ValueError: no|its answer|it answers|TypeError")
def answers_with_a_number_that_raises(view):
    class Frame(float):
        def __float__(self):
            raise ValueError("no")

        def __format__(self, spec):
            raise ValueError("no")

    return Answer(Frame(7.0))


@says("its trace is no flat tuple")
def traces_what_is_no_number(view):
    return Answer(FIRST, (1.0, "2", None))


@says("")
def writes_into_the_shared_memory(view):
    view.score(0, 100)
    for descriptor in range(3, 64):
        with suppress(OSError, ValueError), mmap.mmap(descriptor, 0) as memory:
            memory[:] = b"\xff" * len(memory)


def line_of(view):
    """Return the guest's end of the wire, from which forged messages are sent."""
    return view._view._line


def write_on_the_wire(data):
    """Write bytes into the pipe to the evaluator, the one that is open for writing beside stdout and stderr."""
    for descriptor in range(3, 64):
        with suppress(OSError):
            opened = fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE
            if stat.S_ISFIFO(os.fstat(descriptor).st_mode) and opened == os.O_WRONLY:
                os.write(descriptor, data)
                break
    time.sleep(1000)


def forge(data):
    """Send bytes to the evaluator as if they were a message."""
    write_on_the_wire(len(data).to_bytes(4, "little") + data)


@says("its process sent")
def sends_no_json(view):
    forge(b"no json")


@says("its process sent")
def sends_deep_json(view):
    forge(b"[" * 200_000)


@says("its process sent a message of 4294967295 bytes")
def announces_a_message_of_4_gib(view):
    write_on_the_wire(b"\xff" * 4)


@says("did not answer within")
def sends_half_a_message(view):
    write_on_the_wire((1000).to_bytes(4, "little") + b"{")


@says("its process sent")
def sends_a_list(view):
    forge(b"[1, 2]")


@says("its process sent what nobody had asked for")
def answers_another_run(view):
    forge(json.dumps({"answer": {"frame": 7.0, "trace": [], "note": "", "position": None}, "run": 99}).encode())


@says("its process sent an answer that is none")
def sends_an_answer_that_is_none(view):
    line_of(view).send({"answer": [1, 2], "problem": ""})
    time.sleep(1000)


@says("its process sent scores that are none")
def sends_scores_that_are_none(view):
    answer = {"frame": 7.0, "trace": [], "note": "", "position": None}
    line_of(view).send({"answer": answer, "problem": "", "scores": [["a", {}, []]]})
    time.sleep(1000)


@says("its process asked for an image of the form|its process sent a request")
def asks_for_an_image_that_does_not_exist(view):
    line_of(view).ask({"image": ["truth"], "first": 0, "stop": 1})


@says("its process sent what is no request")
def asks_for_the_truth(view):
    line_of(view).ask({"truth": 1})


@says("BadInput|its process sent a request")
def asks_for_a_window_of_lists(view):
    line_of(view).ask({"image": "counts", "first": [0], "stop": {"a": 1}})


@says("BadInput|its process sent a request")
def asks_for_a_position_of_nothing(view):
    line_of(view).ask({"position": None, "known": -5})


@says("its process does not read|did not answer|sent")
def asks_without_listening(view):
    for _ in range(100_000):
        line_of(view).send({"image": "counts", "first": 0, "stop": 100})
    time.sleep(1000)


@says("its process sent a message of 0 bytes")
def sends_an_empty_message(view):
    write_on_the_wire(bytes(4))


@says("")
def seals_the_shared_memory(view):
    for descriptor in range(3, 64):
        with suppress(OSError):
            fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE)
    view.score(0, 200)


@says("")
def lengthens_the_shared_memory(view):
    for length in (1 << 62, 1 << 30):
        for descriptor in range(3, 64):
            with suppress(OSError):
                os.ftruncate(descriptor, length)
    view.score(0, 200)


@says("MiB of memory")
def fills_files_in_memory(view):
    files = [os.memfd_create(str(number)) for number in range(8)]
    for file in files:
        for _ in range(100):
            os.write(file, bytes(1 << 20))
    time.sleep(1000)


@says("MiB of memory")
def uses_memory_in_a_child_of_a_thread(view):
    code = "x = bytearray(b'x') * (1 << 30)\nimport time\ntime.sleep(60)"
    threading.Thread(target=subprocess.run, args=([sys.executable, "-c", code],)).start()
    time.sleep(1000)


@says("did not answer within")
def opens_a_pipe_that_nobody_writes(view):
    with suppress(OSError):
        os.mkfifo("pipe")
    with Path("pipe").open() as pipe:
        pipe.read()


@says("")
def leaves_a_child_without_an_environment(view):
    subprocess.Popen(["sleep", "1000"], start_new_session=True, env={}, cwd="/", stdout=-3, stderr=-3)


@says("")
def hops_from_process_to_process(view):
    if not os.fork():
        until = time.monotonic() + 20  # lest it outlives a test that fails
        while time.monotonic() < until and not os.fork():
            os.setsid()
        os._exit(0)


@says("")
def prints_for_ever_from_a_thread(view):
    def spin():
        while True:
            os.write(2, b"x" * 65_536)

    threading.Thread(target=spin, daemon=True).start()
    view.score(0, 100)


@says("")
def makes_folders_too_deep_to_delete(view):
    with suppress(OSError):
        for _ in range(1200):
            Path("a").mkdir()
            os.chdir("a")


@says("")
def adopts_its_orphans(view):
    libc = ctypes.CDLL(None)
    libc.prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER
    libc.prctl(1, 0, 0, 0, 0)  # no signal at the end of its parent
    libc.prctl(4, 0, 0, 0, 0)  # its memory cannot be looked at
    subprocess.Popen(["sh", "-c", "sleep 1000 & sleep 1000 &"], start_new_session=True)


def ancestors():
    """Return the processes above this one, as far as they may be asked."""
    found = [os.getppid()]
    with suppress(OSError, ValueError, IndexError):
        while found[-1] > 1:
            found.append(int(Path(f"/proc/{found[-1]}/stat").read_text().rpartition(")")[2].split()[1]))
    return [process for process in found if process > 1]


@says("", shut_in=True)
def signals_the_evaluator(view):
    for process in ancestors():
        with suppress(OSError):
            os.kill(process, 0)  # as SIGTERM and SIGSTOP would be
            return Answer(99.0, note=str(process))


@says("", shut_in=True)
def reads_what_the_evaluator_holds(view):
    for process in ancestors():
        for place in ("environ", "mem", "maps", "fd/0", "fd/1", "fd/2", "cwd", "auxv"):
            with suppress(OSError):
                Path(f"/proc/{process}/{place}").readlink()
                return Answer(99.0, note=f"{process} {place}")
            with suppress(OSError), Path(f"/proc/{process}/{place}").open("rb") as file:
                if file.read(1):
                    return Answer(99.0, note=f"{process} {place}")


@says("", shut_in=True)
def traces_the_evaluator(view):
    libc = ctypes.CDLL(None, use_errno=True)
    for process in ancestors():
        if libc.ptrace(0x4206, process, None, None) == 0:  # PTRACE_SEIZE, which does not stop it
            return Answer(99.0, note=str(process))


@says("", shut_in=True)
def reads_files_of_others(view):
    places = [Path("/root"), Path("/home"), Path(tempfile.gettempdir()).parents[1], *Path(__file__).parents[2:4]]
    for place in places:
        for path in [*place.glob("*"), *place.glob("*/*.h5"), *place.glob("*/.*")][:200]:
            ours = (Path(__file__).parent, sys.prefix, sys.base_prefix)
            if path.is_dir() or any(map(path.is_relative_to, ours)) or "saf-gen-guest" in str(path):
                continue
            if subprocess.run(["cat", path], capture_output=True).stdout:
                return Answer(99.0, note=str(path))
            if (file := ctypes.CDLL(None).open(os.fsencode(path), 0)) >= 0:
                os.close(file)
                return Answer(99.0, note=str(path))


@says("", shut_in=True)
def writes_beside_its_folder(view):
    for place in (Path(__file__).parent, Path(tempfile.gettempdir()).parents[1], Path("/dev/shm")):
        with suppress(OSError):
            (place / "saf-gen-hostile").touch()
            (place / "saf-gen-hostile").unlink()
            return Answer(99.0, note=str(place))


@says("", shut_in=True)
def connects_to_this_machine(view):
    try:
        socket.create_connection(("127.0.0.1", 9), timeout=1).close()
    except PermissionError:
        return
    except OSError as error:
        return Answer(99.0, note=str(error))
    return Answer(99.0)


@says("", shut_in=True)
def leaves_by_a_namespace_of_its_own(view):
    ctypes.CDLL(None).unshare(0x10020000)  # a namespace of users, and one of mounts
    with suppress(OSError):
        return Answer(99.0, note=str(len(list(Path("/").iterdir()))))
