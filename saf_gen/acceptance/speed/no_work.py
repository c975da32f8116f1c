"""A job that does nothing, on which the scheduler is measured.

It lies alone, because a process that is started for it imports this module and not what other benches need.
"""

from dataclasses import dataclass

from saf_gen.core.execution.job import ReportProgress


@dataclass(frozen=True)
class NoWork:
    """A job that only reports, as all do."""

    number: int
    takes_all_cores: bool = False
    wants_gpu: bool = False

    @property
    def name(self) -> str:
        """What it is called in reports."""
        return f"nothing {self.number}"

    def run(self, report: ReportProgress) -> None:
        """Report that it has ended."""
        report(self.name, 1.0)
