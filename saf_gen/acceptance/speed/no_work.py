"""A job that does nothing, on which the scheduler is measured.

It has its own module, so that a process that is started for it does not import what other benches need.
"""

from dataclasses import dataclass

from saf_gen.core.execution.job import ReportProgress


@dataclass(frozen=True)
class NoWork:
    """A job that only reports, as every job does."""

    number: int
    takes_all_cores: bool = False
    wants_gpu: bool = False

    @property
    def name(self) -> str:
        """Name of the job in reports."""
        return f"nothing {self.number}"

    def run(self, report: ReportProgress) -> None:
        """Report that the job has ended."""
        report(self.name, 1.0)
