"""Jobs and where they run: on the cores of this machine or on a Dask cluster."""

from saf_gen.core.execution.dask_cluster import Cluster, SchedulerLost
from saf_gen.core.execution.executor import run_jobs
from saf_gen.core.execution.job import FollowUp, Job, JobResult, ReportProgress

__all__ = ["Cluster", "FollowUp", "Job", "JobResult", "ReportProgress", "SchedulerLost", "run_jobs"]
