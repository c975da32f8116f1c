"""Jobs of a dataset, run in the process of the tests: no worker imports the renderer and numba again."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from saf_gen.errors import SafGenError
from saf_gen.generate.executor import Job, JobResult, ReportProgress, run_generation_jobs

__all__ = ["run_jobs_inline"]


def run_jobs_inline(
    jobs: Sequence[Job],
    *,
    workers: int,
    report: ReportProgress,
    follow_up: Callable[[Any, Any], Iterable[Job]],
    address: str | None,
    tell_retry: Callable[[Job], None] = lambda job: None,
) -> Iterator[JobResult]:
    """Run jobs and those that follow from them one after the other, as run_generation_jobs does on many processes."""
    if address is not None:
        yield from run_generation_jobs(jobs, workers=workers, report=report, follow_up=follow_up, address=address)
        return
    waiting = deque(jobs)
    while waiting:
        job = waiting.popleft()
        try:
            result = job.run(report)
        except SafGenError as error:
            yield job, None, error
        except Exception as error:  # noqa: BLE001  (a pool, too, hands on whatever a job raised)
            yield job, None, SafGenError(f"{type(error).__name__}: {error}")
        else:
            waiting.extend(follow_up(job, result))
            yield job, result, None
