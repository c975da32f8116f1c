"""Jobs of every kind for tests of the executors.

This module does not import pytest, because each worker process imports it.
"""

import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from saf_gen.core.user_code import user_code


class Light:
    """A job that shares the machine and needs no GPU."""

    takes_all_cores = False
    wants_gpu = False


@dataclass(frozen=True)
class Square(Light):
    """A job that succeeds, and reports progress halfway and at its end."""

    number: int

    @property
    def name(self) -> str:
        return f"square {self.number}"

    def run(self, report):
        report(self.name, 0.5)
        report(self.name, 1.0)
        return self.number**2, os.getpid()


@dataclass(frozen=True)
class Raises(Light):
    """A job that raises ``error``."""

    error: BaseException

    @property
    def name(self) -> str:
        return f"raises {type(self.error).__name__}"

    def run(self, report):
        raise self.error


@dataclass(frozen=True)
class Exits(Light):
    """A job that calls ``exit``, as the code of a scene may do."""

    name: str = "exits"

    def run(self, report):
        sys.exit(0)


@dataclass(frozen=True)
class Dies(Light):
    """A job whose process ends at once, as if the kernel had killed it for lack of memory."""

    name: str = "dies"

    def run(self, report):
        os._exit(9)


@dataclass(frozen=True)
class Sleeps(Light):
    """A job that writes its process id to ``note`` and then sleeps."""

    note: Path
    seconds: float = 60.0
    name: str = "sleeps"

    def run(self, report):
        half = self.note.with_suffix(".half")
        half.write_text(str(os.getpid()))
        half.replace(self.note)
        time.sleep(self.seconds)


@dataclass(frozen=True)
class DiesOnce(Light):
    """A job that is killed the first time it runs."""

    mark: Path
    name: str = "dies once"

    def run(self, report):
        if not self.mark.exists():
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return "done"


@dataclass(frozen=True)
class Naps(Light):
    """A job that leaves a file named after its process, and sleeps so that a test can kill it."""

    notes: Path
    number: int

    @property
    def name(self) -> str:
        return f"naps {self.number}"

    def run(self, report):
        (self.notes / str(os.getpid())).touch()
        report(self.name, 0.5)
        time.sleep(0.2)
        return self.number


@dataclass(frozen=True)
class Heavy:
    """A job that takes all cores; it waits at most 20 s for a file ``after``, and then runs for ``seconds``."""

    after: Path
    seconds: float = 0.0
    name: str = "heavy"
    takes_all_cores: bool = True
    wants_gpu = False

    def run(self, report):
        begin = time.monotonic()  # all processes of a machine share this clock
        while not self.after.exists() and time.monotonic() < begin + 20:
            time.sleep(0.02)
        time.sleep(self.seconds)
        return begin, time.monotonic()


@dataclass(frozen=True)
class EndedBy(Light):
    """A job whose process gets a signal that ends it."""

    number: int
    name: str = "ended"

    def run(self, report):
        os.kill(os.getpid(), self.number)
        time.sleep(60)


@dataclass(frozen=True)
class ClosesAll(Light):
    """A job that closes all descriptors of its process."""

    name: str = "closes all"

    def run(self, report):
        os.closerange(0, os.sysconf("SC_OPEN_MAX"))  # the pipe may have a number beyond hundreds of open files


@dataclass(frozen=True)
class Forks(Light):
    """A job that forks; each process that goes on after that leaves a file."""

    notes: Path
    name: str = "forks"

    def run(self, report):
        with user_code():
            os.fork()
        (self.notes / str(os.getpid())).touch()
        return "done"


class Unreadable(Exception):
    """An error that cannot be unpickled, because its two arguments are not those that are pickled."""

    def __init__(self, first, second):
        super().__init__(first)


@dataclass(frozen=True)
class Returns(Light):
    """A job that returns something that cannot be sent or read."""

    what: str

    @property
    def name(self) -> str:
        return f"returns {self.what}"

    def run(self, report):
        return (lambda: None) if self.what == "a lambda" else Unreadable("x", "y")


@dataclass(frozen=True)
class Unsendable(Light):
    """A job that cannot be sent, because of what it holds."""

    held: object
    name: str = "unsendable"

    def run(self, report):
        return self.held
