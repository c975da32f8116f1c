"""Methods that are hostile or clumsy, and what their rows must say; the file is loaded as a stranger's.

Each search of HOSTILE is run alone by tests/benchmark/test_guests.py. The reason is a regular expression for the note
of the failed run, or "" if the method must answer like any other.
"""

import atexit
import ctypes
import gc
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from functools import wraps
from pathlib import Path

import numpy as np

from saf_gen.parts import Answer

HOSTILE = {}
FIRST = 7.0  # the answer of all that answer


def says(reason):
    def note(function):
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


@says("ended with exit code|closed its wire|OSError|its process sent")
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


@says("ended with exit code 0|closed its wire")
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


@says("its process sent|closed its wire|did not answer")
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


@says("BadInput: the lens of a recording cannot be moved")
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
