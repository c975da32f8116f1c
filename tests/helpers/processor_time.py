"""Processor seconds of each test, with those of the processes that it started; the dearest are listed at the end.

``slow`` is a test that takes more than 0.15 s by this clock, which says the same beside other work. What a fixture of a
module or session costs is counted for the first test that uses it.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

DEAREST = 40
KEY = "processor_s"


def processor_s() -> float:
    """Return the seconds of this process and of those of its children that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class ProcessorTime:
    """Takes the time of each test where it runs, and lists them where the run is reported.

    Parameters
    ----------
    table : Path or None
        File to which a line is added for each test.
    """

    def __init__(self, table: Path | None) -> None:
        self._table, self._seconds = table, dict[str, float]()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        item.stash[_BEGIN] = processor_s()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: "pytest.CallInfo[None]") -> Iterator[None]:
        report = yield
        if call.when == "teardown":
            report.user_properties.append((KEY, processor_s() - item.stash[_BEGIN]))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        seconds = dict(report.user_properties).get(KEY)
        if seconds is None:
            return
        self._seconds[report.nodeid] = seconds
        if self._table is not None:  # at once, so that a run that is stopped leaves what it knows
            with self._table.open("a") as file:
                file.write(f"{seconds:.3f} {report.nodeid}\n")

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        dearest = sorted(self._seconds.items(), key=lambda pair: -pair[1])
        if len(dearest) < 1_000:  # a few files, of which nobody asks it
            return
        total = sum(self._seconds.values())
        terminalreporter.section(f"{total:.0f} processor seconds in {len(dearest)} tests, the dearest {DEAREST}")
        for name, seconds in dearest[:DEAREST]:
            terminalreporter.line(f"{seconds:6.2f} {name}")


_BEGIN = pytest.StashKey[float]()
