"""Runs the jobs of a dataset in the process of the tests, so that no worker has to import the renderer and numba."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence

from saf_gen.core.execution import Cluster, FollowUp, Job, JobResult, ReportProgress, run_jobs
from saf_gen.errors import SafGenError

__all__ = ["run_jobs_inline"]


def run_jobs_inline(
    jobs: Sequence[Job],
    *,
    workers: int,
    report: ReportProgress,
    follow_up: FollowUp = lambda job, result: (),
    cluster: Cluster | None = None,
    notify: Callable[[str], None] = lambda line: None,
) -> Iterator[JobResult]:
    """Run jobs and their follow-ups one after the other, with the interface of run_jobs."""
    if cluster is not None:
        yield from run_jobs(jobs, workers=workers, report=report, follow_up=follow_up, cluster=cluster, notify=notify)
        return
    waiting = deque(jobs)
    while waiting:
        job = waiting.popleft()
        try:
            result = job.run(report)
        except SafGenError as error:
            yield job, None, error
        except Exception as error:  # noqa: BLE001  (a pool passes on any exception, too)
            yield job, None, SafGenError(f"{type(error).__name__}: {error}")
        else:
            waiting.extend(follow_up(job, result))
            yield job, result, None
