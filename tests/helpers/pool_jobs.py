"""Jobs of every kind for tests of the executors.

This module does not import pytest, because each worker process imports it.
"""

import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path


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
