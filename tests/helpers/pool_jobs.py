"""Jobs of every kind for the tests of what runs them.

They lie alone, without pytest: each process that is started for them imports this module.
"""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path


class Light:
    """What all jobs here say of themselves."""

    takes_all_cores = False
    wants_gpu = False


@dataclass(frozen=True)
class Square(Light):
    """A job that does well, and reports half way and at its end."""

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
    """A job that fails in a way of its own."""

    error: BaseException

    @property
    def name(self) -> str:
        return f"raises {type(self.error).__name__}"

    def run(self, report):
        raise self.error


@dataclass(frozen=True)
class Dies(Light):
    """A job whose whole process is gone, as when the kernel takes its memory back."""

    name: str = "dies"

    def run(self, report):
        os._exit(9)


@dataclass(frozen=True)
class Sleeps(Light):
    """A job that says where it runs, and takes its time."""

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
    """A job whose first process is killed."""

    mark: Path
    name: str = "dies once"

    def run(self, report):
        if not self.mark.exists():
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return "done"


@dataclass(frozen=True)
class Naps(Light):
    """A job that can be killed in its sleep."""

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
    """A job that wants the machine for itself: ``seconds`` long once there is a file ``after``, or after 20 s."""

    after: Path
    seconds: float = 0.0
    name: str = "heavy"
    takes_all_cores: bool = True
    wants_gpu = False

    def run(self, report):
        begin = time.monotonic()  # one clock for all processes of a machine
        while not self.after.exists() and time.monotonic() < begin + 20:
            time.sleep(0.02)
        time.sleep(self.seconds)
        return begin, time.monotonic()
