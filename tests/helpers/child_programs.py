"""Programs of children for tests; each takes its end of the line. This module does not import pytest."""

import fcntl
import os
import signal
import socket
import subprocess
import sys
import threading
import time

from saf_gen.core.child import Line

__all__ = ["fcntl", "signal", "socket", "subprocess"]  # what attempts use


def echoes():
    line = Line(1 << 23)
    while (message := line.receive()) is not None:
        line.send(message)


def sends_too_much():
    Line(1000).send(b"x" * ((1 << 20) + 1))
    time.sleep(60)


def sends_nothing():
    Line(1000).send(b"")
    time.sleep(60)


def sends_half():
    line = Line(1000)
    line._outgoing.write(b"\x10\0\0\0{")
    line._outgoing.flush()
    time.sleep(60)


def exits():
    sys.exit(7)


def kills_itself():
    os.kill(os.getpid(), signal.SIGKILL)


def kills_its_group():
    os.killpg(0, signal.SIGTERM)


def closes_its_line():
    os.closerange(0, 1000)
    time.sleep(60)


def leaves_its_line_to_a_daemon():
    if not os.fork():
        os.setsid()
        time.sleep(60)
    os._exit(0)


def sleeps():
    line = Line(1000)
    time.sleep(60)
    line.receive()


def prints_and_exits():
    line = Line(1000)
    sys.stdout.write("by print\n")
    sys.stdout.flush()
    os.write(2, b"by write\n")
    line.send(b"")


def _daemon(environment=None):
    code = "import os, time; os.fork() and os._exit(0); os.setsid(); print(os.getpid(), flush=True); time.sleep(60)"
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", code], stdout=subprocess.PIPE, env=environment, start_new_session=True
    )
    return process.stdout.readline().decode().strip()


def leaves_daemons():
    Line(1000).send(" ".join([str(os.getpid()), _daemon(), _daemon()]).encode())
    time.sleep(60)


def leaves_daemons_without_an_environment():
    Line(1000).send(" ".join([str(os.getpid()), _daemon({}), _daemon({})]).encode())
    os._exit(0)


def hops():
    """Two processes that each fork and end, over and over."""
    line, hoppers = Line(1000), []
    for _ in range(2):
        hopper = os.fork()
        if not hopper:
            while not os.fork():
                os.setsid()
            os._exit(0)
        hoppers.append(hopper)
    line.send(" ".join(map(str, [os.getpid(), *hoppers])).encode())
    time.sleep(60)


def holds_memory_in_a_child_of_a_thread():
    line = Line(1000)
    code = "held = bytearray(b'x') * (300 << 20); print(1, flush=True); import time; time.sleep(60)"

    def start():
        process = subprocess.Popen([sys.executable, "-I", "-S", "-c", code], stdout=subprocess.PIPE)
        process.stdout.readline()
        line.send(b"holds")
        time.sleep(60)

    threading.Thread(target=start).start()


def holds_files_in_memory():
    line, files = Line(1000), [os.memfd_create(str(number)) for number in range(3)]
    for file in files:
        for _ in range(100):
            os.write(file, b"x" * (1 << 20))
    os.dup(files[0])
    line.send(b"holds")
    time.sleep(60)


def lengthens_the_memory():
    line = Line(1000)
    file = int(line.receive())
    os.ftruncate(file, 1 << 60)
    try:
        fcntl.fcntl(file, fcntl.F_ADD_SEALS, fcntl.F_SEAL_GROW)
    except OSError as error:
        line.send(type(error).__name__.encode())
    else:
        line.send(b"nothing")


def tries():
    line = Line(1 << 20)
    line.send(b"begun")
    while (attempt := line.receive()) is not None:
        try:
            outcome = repr(eval(attempt))
        except Exception as error:  # noqa: BLE001
            outcome = type(error).__name__
        line.send(outcome.encode())
