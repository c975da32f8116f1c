"""Jobs on a Dask cluster: many machines that share one folder.

Differences between machines could silently produce wrong data, so each worker must have the same versions as the
machine that hands out the jobs, and see its folder. This is checked on all workers before the first job, and again
before every job, because workers may join later. A worker that dies costs only time: the scheduler gives its jobs to
others, and a line of text reports it. Another does if a worker or the scheduler says nothing for long, as if it was
stopped; the run goes on when it wakes. If the scheduler is lost, finished work is kept, and :class:`SchedulerLost` is
raised.
"""

import hashlib
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from secrets import token_hex
from typing import Any

from saf_gen.core.execution.dask_connection import connect, list_workers, silence_dask, within
from saf_gen.core.execution.job import FollowUp, Job, JobResult, ReportProgress, describe_job_error
from saf_gen.core.execution.silence import Silence
from saf_gen.core.extras import installed_versions, require_extra
from saf_gen.core.files import check_file_system, remove_leftovers, temporary_name
from saf_gen.core.plain_text import plural
from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput, SafGenError

LOOK_FOR_WORKERS_S = 5.0
ANSWER_S = 30.0
"""Time in which workers must answer before the first job."""
IF_SILENT = (
    "if it does not wake, the scheduler gives its work to other workers (distributed.scheduler.worker-ttl, 5 minutes "
    "by default)"
)
_JOB_LOCK = threading.Lock()


class SchedulerLost(SafGenError):
    """Error for a cluster whose scheduler no longer answers; the results of finished jobs are on disk."""


@dataclass(frozen=True)
class Cluster:
    """A Dask cluster that runs jobs.

    Parameters
    ----------
    address : str
        Address of its scheduler, such as ``tcp://host:8786`` or ``tls://host:8786``.
    folder : Path
        Folder that the jobs read or write; it must be the same on every machine.
    writes : bool, default False
        Whether jobs write to the folder.
    """

    address: str
    folder: Path
    writes: bool = False


@dataclass(frozen=True)
class _Conditions:
    """The conditions that a worker must share with the machine that hands out the jobs."""

    versions: dict[str, str]
    witness: Path
    digest: str
    writes: bool

    def find_problem(self) -> str:
        """Return a description of the first condition that this machine does not meet, or '' if it meets all."""
        here = installed_versions()
        other = [
            f"{name} {here[name]}, not {expected}" for name, expected in self.versions.items() if here[name] != expected
        ]
        if other:
            return f"has {'; '.join(other)} (install the versions in constraints.txt on all machines)"
        if _digest_file(self.witness) != self.digest:
            return f"does not see {self.witness.parent} (it must be the same folder, under this path, on all machines)"
        return ""

    def find_problem_at_start(self) -> str:
        """Return what :meth:`find_problem` returns, or what is wrong with the file system that jobs write to."""
        try:
            problem = self.find_problem()
            if self.writes and not problem:
                check_file_system(self.witness.parent)
                remove_leftovers(
                    self.witness.parent, recursive=True
                )  # files of jobs whose process was killed on this machine
            return problem
        except BadInput as error:
            return f"cannot use the folder: {error}"


def _digest_file(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


@contextmanager
def _agree_on_conditions(cluster: Cluster) -> Iterator[_Conditions]:
    """Yield the conditions that all workers must meet: the same packages, and the same folder.

    A worker recognises the folder by a file with random content, which is removed at the end, or by the manifest if
    jobs only read.
    """
    with ExitStack() as undo:
        folder = cluster.folder.resolve()
        witness = folder / "manifest.json" if folder.is_dir() else folder
        if cluster.writes:
            folder.mkdir(parents=True, exist_ok=True)
            witness = temporary_name(folder / "seen")
            undo.callback(witness.unlink, missing_ok=True)
            witness.write_text(token_hex(16), encoding="utf-8")
        yield _Conditions(installed_versions(), witness, _digest_file(witness), cluster.writes)


def _run_on_worker(job: Job, conditions: _Conditions) -> tuple[Any, SafGenError | None]:
    """Return the result and the error of a job, which runs alone in its process."""
    if problem := conditions.find_problem():
        return None, SafGenError(f"a worker that joined later {problem}")
    with _JOB_LOCK:  # Dr.Jit and numba's threads belong to one job at a time
        try:
            with user_code():
                return job.run(lambda name, done: None), None  # a cluster reports no progress within jobs
        except Exception as error:  # noqa: BLE001  (whatever a job raised is its result, as in a pool)
            return None, describe_job_error(error)


def run_on_dask(
    jobs: Sequence[Job], cluster: Cluster, *, report: ReportProgress, follow_up: FollowUp, notify: Callable[[str], None]
) -> Generator[JobResult]:
    """Run jobs, and the jobs that follow from them, on a cluster, and yield each when it ends.

    If a worker ends, the scheduler gives its job to another one, and ``notify`` is called with a line of text about it.
    A job has failed if its workers have died more often than the scheduler allows
    (``distributed.scheduler.allowed-failures``, 3). A job that wants a GPU goes to a worker with the resource ``GPU``
    if a worker offers it when the run begins.

    Raises
    ------
    BadInput
        If no scheduler answers at the address, if it has another version of Dask, or if a worker has other versions,
        does not answer or see the folder, or has a file system that cannot hold a dataset.
    SchedulerLost
        If the scheduler ends or can no longer be reached; jobs that ended earlier have been yielded.
    """
    require_extra("cluster", "distributed", of="--cluster")
    with silence_dask(), connect(cluster.address) as client, _agree_on_conditions(cluster) as conditions:
        yield from _Dispatcher(client, cluster.address, conditions=conditions, notify=notify).run(
            jobs, report=report, follow_up=follow_up
        )


class _Dispatcher:
    """Hands jobs to a cluster, and notices when they end, when workers leave or fall silent, and a lost scheduler."""

    def __init__(self, client: Any, address: str, *, conditions: _Conditions, notify: Callable[[str], None]) -> None:
        self._client, self._address, self._conditions, self._notify = client, address, conditions, notify
        self._running: dict[str, tuple[Job, Any]] = {}
        self._messages: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._waits_for_workers = False
        self._scheduler = Silence(notify)
        self._workers: dict[str, tuple[float, Silence]] = {}  # when the scheduler heard of each, by its own clock

    def run(self, jobs: Sequence[Job], *, report: ReportProgress, follow_up: FollowUp) -> Iterator[JobResult]:
        over = threading.Event()
        with self._notice_loss():
            self._check_workers()
            self._client.subscribe_topic("all", lambda event: self._messages.put(("event", event[1])))
            self._submit(jobs)
        self._scheduler.end()
        threading.Thread(target=self._watch, args=(over,), daemon=True).start()
        try:
            yield from self._collect(report, follow_up)
        finally:
            over.set()
            # Without this, the scheduler would go on writing to a client that has gone.
            with suppress(CancelledError, OSError, RuntimeError):
                self._client.unsubscribe_topic("all")

    def _collect(self, report: ReportProgress, follow_up: FollowUp) -> Generator[JobResult]:
        while self._running:
            with self._notice_loss():
                ended = self._next_ended()
            if ended is None:
                continue
            job, (result, error) = ended
            report(job.name, 1.0)
            if error is None:
                with self._notice_loss():
                    self._submit(follow_up(job, result))
            yield job, result, error

    @contextmanager
    def _notice_loss(self) -> Iterator[None]:
        """Raise SchedulerLost in place of the exceptions that Dask raises once the connection is lost."""
        try:
            yield
        except BadInput:
            raise
        except (CancelledError, OSError, RuntimeError, TimeoutError) as error:
            raise SchedulerLost(f"the Dask scheduler at {self._address} does not answer any more") from error

    def _check_workers(self) -> None:
        """Raise BadInput if one of the workers present cannot run jobs of this machine, or does not answer."""
        find_problem = self._conditions.find_problem_at_start
        try:
            problems = within(ANSWER_S, lambda: self._client.run(find_problem, on_error="return"))
        except TimeoutError:
            raise self._silent_at_start() from None
        found = {worker: problem for worker, problem in problems.items() if problem}
        for worker, problem in found.items():
            if isinstance(problem, BaseException):
                problem = f"cannot run saf_gen: {type(problem).__name__}: {problem}"
            raise BadInput(f"{len(found)} of {len(problems)} workers cannot be used: {worker} {problem}")
        workers = self._list_workers().values()
        self._has_gpus = any(worker["resources"].get("GPU") for worker in workers)

    def _list_workers(self) -> dict[str, Any]:
        workers: dict[str, Any] = within(ANSWER_S, lambda: list_workers(self._client))
        return workers

    def _silent_at_start(self) -> BadInput:
        """Return the error for workers that do not answer when they are asked for their versions."""
        workers = self._list_workers()
        if not workers:
            return BadInput(
                f"all workers of the scheduler at {self._address} left it before they answered",
                hint="start workers, and run the same command again",
            )
        heard_s = {address: worker["last_seen"] for address, worker in workers.items()}
        latest_s = max(heard_s.values())
        silent = [address for address, then_s in heard_s.items() if latest_s - then_s > ANSWER_S / 2] or list(heard_s)
        return BadInput(
            f"{len(silent)} of {plural(len(workers), 'worker')} of the scheduler at {self._address} gave no answer "
            f"within {ANSWER_S:.0f} s: {', '.join(silent)}",
            hint="wake or end them, and run the same command again",
        )

    def _submit(self, jobs: Iterable[Job]) -> None:
        for job in jobs:
            future = self._client.submit(
                _run_on_worker,
                job,
                self._conditions,
                key=f"{job.name}-{token_hex(4)}",
                pure=False,
                resources={"GPU": 1} if job.wants_gpu and self._has_gpus else None,
            )
            self._running[future.key] = job, future
            future.add_done_callback(lambda future: self._messages.put(("ended", future.key)))

    def _next_ended(self) -> tuple[Job, tuple[Any, SafGenError | None]] | None:
        """Return a job that has ended and its outcome; None after another message, or after a while without any."""
        self._scheduler.tell(f"the scheduler at {self._address}", "the run goes on when it answers")
        try:
            kind, message = self._messages.get(timeout=LOOK_FOR_WORKERS_S)
        except Empty:
            return None
        if kind == "event":
            self._notify_of_lost_worker(message)
            return None
        if kind == "seen":
            self._note_workers(*message)
            return None
        job, future = self._running[message]
        if future.cancelled():  # only Dask cancels futures, when the connection is lost
            raise CancelledError
        if future.status == "error":
            outcome = None, _describe_dask_error(future.exception())
        else:
            try:
                outcome = future.result(timeout=LOOK_FOR_WORKERS_S)
            except TimeoutError:  # the worker that holds it is silent
                self._messages.put((kind, message))
                return None
            future.release()  # if Dask runs a finished job again, the job finds its file
        del self._running[message]
        return job, outcome

    def _notify_of_lost_worker(self, event: Any) -> None:
        if event.get("action") != "remove-worker":
            return
        _, silence = self._workers.pop(event["worker"], (0.0, None))
        why = "ended" if event.get("expected") else "died: killed, or out of memory?"
        if silence and silence.is_long:
            why = "was silent for too long"
        for key in event.get("processing-tasks", ()):
            if key in self._running:
                self._notify(f"again: {self._running[key][0].name} (its worker {event['worker']} {why})")

    def _watch(self, over: threading.Event) -> None:
        """Ask the scheduler again and again for its workers, in a thread of its own, because it may never answer."""
        while not over.is_set():
            try:
                workers = list_workers(self._client)
                silent = [address for address, (_, silence) in list(self._workers.items()) if silence.is_long]
                held = self._client.processing(silent) if silent else {}
            except Exception:  # noqa: BLE001  (the connection is lost, which all futures notice)
                return
            heard_s = {address: worker["last_seen"] for address, worker in workers.items()}
            self._messages.put(("seen", (heard_s, held)))
            over.wait(LOOK_FOR_WORKERS_S)

    def _note_workers(self, heard_s: dict[str, float], held: dict[str, Any]) -> None:
        """Report workers that have fallen silent or answer again, and a lack of workers, each once.

        A batch system may take hours to start a worker.
        """
        self._scheduler.end(f"the scheduler at {self._address}")
        for address in self._workers.keys() - heard_s.keys():
            del self._workers[address]
        for address, seen_s in heard_s.items():
            before_s, silence = self._workers.setdefault(address, (seen_s, Silence(self._notify)))
            if seen_s != before_s:
                silence.end(f"the worker {address}")
                self._workers[address] = seen_s, silence
            elif jobs := [self._running[key][0].name for key in held.get(address, ()) if key in self._running]:
                more = f" and {len(jobs) - 1} more" if len(jobs) > 1 else ""
                silence.tell(f"the worker {address}, which has {jobs[0]}{more},", IF_SILENT)
        if not heard_s and not self._waits_for_workers:
            self._notify(f"waiting: the scheduler at {self._address} has no workers; {len(self._running)} jobs wait")
        self._waits_for_workers = not heard_s


def _describe_dask_error(error: BaseException) -> SafGenError:
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        times = plural(error.allowed_failures + 1, "worker")
        return SafGenError(f"{times} died running it (killed, or out of memory?); run the same command again")
    return describe_job_error(error)
