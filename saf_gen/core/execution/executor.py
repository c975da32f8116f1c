"""Runs jobs, and the jobs that follow from them, on the cores of this machine or on a Dask cluster."""

import multiprocessing
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, wait

from saf_gen.core.execution.dask_cluster import Cluster, run_jobs_on_dask
from saf_gen.core.execution.job import FollowUp, Job, JobResult, ReportProgress, describe_job_error
from saf_gen.core.execution.worker_pool import WorkerPool


def run_jobs(
    jobs: Sequence[Job],
    *,
    workers: int,
    report: ReportProgress,
    follow_up: FollowUp = lambda job, result: (),
    cluster: Cluster | None = None,
    tell: Callable[[str], None] = lambda line: None,
) -> Generator[JobResult]:
    """Run jobs and those that follow from them, and yield each as it ends.

    On this machine ``workers`` jobs run at a time, and beside them one of those that take all cores, so that
    cores that are idle (a file is being written, a scene loaded) are used. Where a job fails, its error is
    yielded, nothing follows from it, and the others go on. A job whose process dies is run once more, alone; one that
    dies twice is set aside. ``tell`` is called with a line for people for each job that is run again, and why. With
    ``cluster`` a Dask cluster runs the jobs; :func:`saf_gen.core.execution.dask_cluster.run_jobs_on_dask` says how.
    """
    if not jobs:
        nothing: tuple[JobResult, ...] = ()
        return (ended for ended in nothing)
    if cluster is not None:
        return run_jobs_on_dask(jobs, cluster, report=report, follow_up=follow_up, tell=tell)
    return _run_on_cores(jobs, workers, report=report, follow_up=follow_up, tell=tell)


def _run_on_cores(
    jobs: Sequence[Job], workers: int, *, report: ReportProgress, follow_up: FollowUp, tell: Callable[[str], None]
) -> Generator[JobResult]:
    others = set(multiprocessing.active_children())  # these belong to the program that calls this function
    pools = alone, side_by_side = tuple(WorkerPool(count, tell=tell) for count in (1, workers))

    def add(jobs: Iterable[Job]) -> None:
        for job in jobs:
            (alone if job.takes_all_cores else side_by_side).add([job])

    try:
        add(jobs)
        while futures := [future for pool in pools for future in pool.futures]:
            wait(futures, timeout=0.2, return_when=FIRST_COMPLETED)
            for pool in pools:
                for job, future in pool.collect(report):
                    error = future.exception()
                    if error is not None:
                        yield job, None, describe_job_error(error)
                        continue
                    add(follow_up(job, future.result()))
                    yield job, future.result(), None
    except BaseException:
        # A job may be ended in the middle, and waiting for a render to finish could take minutes.
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        for pool in pools:
            pool.close(cancel=True)
        raise
    for pool in pools:
        pool.close()
