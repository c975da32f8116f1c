"""A job that does nothing, for measuring the scheduler.

It is alone in this module, so that the processes that run it do not import the code of other benches.
"""

from dataclasses import dataclass

from saf_gen.core.execution.job import ReportProgress


@dataclass(frozen=True)
class NoWork:
    """A job that does nothing but report its end."""

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
