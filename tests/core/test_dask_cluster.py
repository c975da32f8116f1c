"""Jobs on a Dask cluster on this machine: results, refusals, workers that die, a lost scheduler."""

import errno
import os
import shutil
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import distributed
import pytest
from dask_processes import scheduler_process, wait_until, worker_processes
from foreign_listeners import listener
from pool_jobs import DiesOnce, Exits, Light, Raises, Square
from refusals import assert_says, refusal
from test_executor import done

from saf_gen.core.execution import Cluster, SchedulerLost, dask_cluster, dask_connection, run_jobs, silence
from saf_gen.core.execution.dask_connection import list_workers
from saf_gen.errors import BadInput


@pytest.fixture
def cluster(cluster_address, tmp_path):
    return Cluster(cluster_address, tmp_path, writes=True)


@pytest.fixture
def short_connection(monkeypatch):
    """Wait for half a second in place of 10 s and 3 s."""
    for name in ("CONNECT_S", "LOOK_S"):
        monkeypatch.setattr(dask_connection, name, 0.5)


@pytest.fixture
def frequent_looks(monkeypatch):
    """Look for workers every 0.2 s in place of 5 s."""
    monkeypatch.setattr(dask_cluster, "LOOK_FOR_WORKERS_S", 0.2)


def followers(job, result):
    """Square a one-digit result again."""
    return [Square(result[0])] if result[0] < 10 else []


def test_a_cluster_gives_what_cores_give_and_names_what_failed(cluster):
    raised = BadInput("no such group"), OSError(28, "No space left"), ZeroDivisionError()
    jobs = [Square(3), *map(Raises, raised), Exits()]
    heard, results, codes = [], {}, {}
    for job, result, error in run_jobs(
        jobs, workers=1, report=lambda name, done: heard.append((name, done)), cluster=cluster, follow_up=followers
    ):
        results[job.name], codes[job.name] = (result[0], "") if error is None else (None, str(error)), error
    assert (results["square 3"], results["square 9"]) == ((9, ""), (81, ""))
    assert results["raises BadInput"] == (None, "no such group")
    assert "No space left" in results["raises OSError"][1]
    assert results["exits"] == (None, "CodeStopped: its code called exit(0)")
    assert [codes[f"raises {name}"].exit_code for name in ("BadInput", "ZeroDivisionError")] == [2, 1]
    assert ("square 9", 1.0) in heard
    assert not list(cluster.folder.iterdir())


@dataclass(frozen=True)
class Where(Light):
    """A job that returns the name of its worker."""

    number: int
    wants_gpu: bool

    @property
    def name(self) -> str:
        return f"where {self.number}"

    def run(self, report):
        return distributed.get_worker().name


def test_jobs_that_want_a_gpu_go_to_the_worker_that_offers_one(cluster):
    results = done([*(Where(n, True) for n in range(4)), *(Where(n, False) for n in range(4, 12))], cluster=cluster)
    assert {results[f"where {n}"][0] for n in range(4)} == {"card"}
    assert "plain" in {results[f"where {n}"][0] for n in range(4, 12)}


def other_folder(patch):
    """What is read is different each time, as if each machine had another folder under this path."""
    patch.setattr(Path, "read_bytes", lambda path: os.urandom(4))


def no_renaming(patch):
    def refuse(self, target):
        raise OSError(errno.ENOSYS, "")

    patch.setattr(Path, "replace", refuse)


def other_dask(patch):
    real = distributed.versions.get_versions

    def get_versions(**how):
        versions = real(**how)
        return versions | {"packages": versions["packages"] | {"distributed": "2024.1.0"}}

    patch.setattr(distributed.versions, "get_versions", get_versions)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (other_folder, "2 of 2 workers | does not see FOLDER"),
        (no_renaming, "replace a file by another | atomic renaming"),
        (other_dask, f"the scheduler at ADDRESS has distributed {distributed.__version__}, not 2024.1.0"),
    ],
)
def test_a_cluster_that_cannot_work_on_the_folder_is_refused_in_one_line(cluster, monkeypatch, change, message):
    change(monkeypatch)
    message = message.replace("FOLDER", str(cluster.folder)).replace("ADDRESS", cluster.address)
    assert_says(refusal(done, [Square(1)], cluster=cluster), message)


OTHER = "something else listens there, which does not speak Dask's protocol"


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("nothing", "nothing listens on port"),
        ("silent", "something listens there, but says nothing"),
        ("closes", "something listens there, but says nothing"),
        ("http", "a web server listens there, perhaps the dashboard | 8786"),
        ("ssh", OTHER),
        ("noise", OTHER),
        ("zeros", OTHER),
        ("announces a petabyte", OTHER),
        ("drips", OTHER),
    ],
)
def test_what_is_no_scheduler_is_one_line_that_says_what_it_is(kind, why, tmp_path, short_connection):
    with listener(kind) as address:
        begin = time.monotonic()
        problem = refusal(done, [Square(1)], cluster=Cluster(address, tmp_path))
        assert_says(problem, f"no Dask scheduler answers at {address!r}: {why} | tcp://host:8786 | `dask scheduler`")
        assert time.monotonic() - begin < 20  # with 10 s and 3 s in place of these halves, at most 30 s
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("tcp://no-such-host.invalid:8786", "the host 'no-such-host.invalid' is unknown"),
        ("http://127.0.0.1:8786", "'http' is no protocol of Dask | did you mean 'tcp'?"),
        ("tcs://127.0.0.1:8786", "'tcs' is no protocol of Dask | did you mean"),
        ("tls://127.0.0.1:8786", "no certificates are set"),
        ("tcp://127.0.0.1", "missing port number"),
        ("tcp://127.0.0.1:99999", "it needs a host, and a port from 1 to 65535"),
        ("tcp://127.0.0.1:http", ""),
        ("somewhere", "missing port number"),
        ("", ""),
    ],
)
def test_an_address_of_no_scheduler_is_one_line(address, why, tmp_path, short_connection):
    problem = refusal(done, [Square(1)], cluster=Cluster(address, tmp_path))
    assert_says(problem, f"no Dask scheduler answers at {address!r}: {why}")


def test_the_address_of_a_worker_is_refused(cluster, tmp_path):
    with distributed.Client(cluster.address, set_as_default=False) as client:
        worker = next(iter(list_workers(client)))
    problem = refusal(done, [Square(1)], cluster=Cluster(worker, tmp_path))
    assert_says(problem, f"no Dask scheduler answers at {worker!r}: it is the address of a worker")


def test_workers_are_listed_whatever_the_timer_of_the_client_does(cluster):
    with distributed.Client(cluster.address, set_as_default=False) as client:

        async def empty(n_workers=0):  # what the timer does between a question and its answer
            client._scheduler_identity = {"workers": {}}

        client._update_scheduler_info = empty
        assert client.scheduler_info(n_workers=-1)["workers"] == {}
        assert len(list_workers(client)) >= 1


def test_workers_that_leave_before_they_answer_are_one_line(cluster, monkeypatch):
    monkeypatch.setattr(dask_cluster, "ANSWER_S", 0.5)
    monkeypatch.setattr(dask_cluster, "list_workers", lambda client: {})
    monkeypatch.setattr(distributed.Client, "run", lambda *given, **options: time.sleep(2.0))
    problem = refusal(done, [Square(1)], cluster=cluster)
    assert_says(
        problem, f"all workers of the scheduler at {cluster.address} left it before they answered | start workers"
    )


def test_a_cluster_without_dask_is_one_line_with_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "distributed", None)
    problem = refusal(done, [Square(1)], cluster=Cluster("tcp://here:8786", tmp_path))
    assert_says(problem, "--cluster needs the package distributed | pip install 'saf-gen[cluster]'")


# Workers and a scheduler in separate processes.


@dataclass(frozen=True)
class Waits(Light):
    """A job that writes its process id, and waits for a file ``go``."""

    folder: Path
    name: str = "waits"

    def run(self, report):
        (self.folder / "pid.half").write_text(str(os.getpid()))
        (self.folder / "pid.half").replace(self.folder / "pid")
        wait_until((self.folder / "go").exists)
        return self.name


@pytest.mark.slow
def test_workers_that_die_or_join_and_a_lost_scheduler_are_one_line_each(tmp_path, capfd):
    """All is tested on one cluster, because each process takes a second to start."""
    with scheduler_process(tmp_path) as (scheduler, address):
        cluster, lines = Cluster(address, tmp_path, writes=True), []

        with ThreadPoolExecutor(1) as thread:  # there is no worker yet
            monkeypatch_seconds = pytest.MonkeyPatch()
            monkeypatch_seconds.setattr(dask_cluster, "LOOK_FOR_WORKERS_S", 0.1)
            waits = thread.submit(done, [Square(3)], cluster=cluster, notify=lines.append)
            wait_until(lambda: lines)
            with worker_processes(tmp_path, address):
                assert waits.result(60)["square 3"][0][0] == 9
                monkeypatch_seconds.undo()
                assert lines == [f"waiting: the scheduler at {address} has no workers; 1 jobs wait"]
                lines.clear()

                mark = tmp_path / "mark"
                results = done([DiesOnce(mark), *(Square(n) for n in range(5))], cluster=cluster, notify=lines.append)
                assert results["dies once"] == ("done", "")
                assert [results[f"square {n}"][0][0] for n in range(5)] == [n * n for n in range(5)]
                assert all(line.endswith("died: killed, or out of memory?)") for line in lines)
                assert sum(line.startswith("again: dies once (its worker tcp://127.0.0.1:") for line in lines) == 1

                other_code = tmp_path / "other" / "saf_gen"
                shutil.copytree(Path(sys.modules["saf_gen"].__file__).parent, other_code)
                (other_code / "errors.py").write_text("# changed\n" + (other_code / "errors.py").read_text())
                path = os.pathsep.join([str(other_code.parent), *sys.path])
                with worker_processes(tmp_path, address, "--name", "other", PYTHONPATH=path):
                    with distributed.Client(address, set_as_default=False) as client:
                        client.wait_for_workers(3, timeout=60)
                    problem = refusal(done, [Square(1)], cluster=cluster)
                    assert_says(problem, "1 of 3 workers | has saf_gen  | constraints.txt")

                with distributed.Client(address, set_as_default=False) as client:  # the other worker has left
                    wait_until(lambda: len(list_workers(client)) == 2)
                lost = thread.submit(done, [Waits(tmp_path)], cluster=cluster)
                wait_until((tmp_path / "pid").exists)
                os.killpg(scheduler.pid, signal.SIGKILL)
                problem = lost.exception(60)
                assert isinstance(problem, SchedulerLost)
                assert_says(problem, f"the Dask scheduler at {address} does not answer any more")
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_a_worker_and_a_scheduler_that_fall_silent_are_told_and_the_run_goes_on_when_they_wake(
    tmp_path, monkeypatch, frequent_looks
):
    monkeypatch.setattr(silence, "TELL_AFTER_S", 1.5)
    with (
        scheduler_process(tmp_path) as (scheduler, address),
        worker_processes(tmp_path, address, "--nworkers", "1") as nanny,
        ThreadPoolExecutor(1) as thread,
    ):
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=60)
            name = next(iter(list_workers(client)))
        cluster, lines, heard = Cluster(address, tmp_path, writes=True), [], []
        run = thread.submit(
            done, [Waits(tmp_path)], cluster=cluster, notify=lines.append, report=lambda *step: heard.append(step)
        )
        wait_until((tmp_path / "pid").exists)
        worker = int((tmp_path / "pid").read_text())
        for stopped, who in ((worker, f"the worker {name}"), (scheduler.pid, f"the scheduler at {address}")):
            lines.clear()
            os.kill(stopped, signal.SIGSTOP)
            wait_until(lambda: lines)
            assert lines[0].startswith(f"waiting: {who}")
            assert " has said nothing for " in lines[0]
            assert lines[0].endswith("; Ctrl-C stops")
            assert ("which has waits" in lines[0]) == (stopped == worker)
            os.kill(stopped, signal.SIGCONT)
            wait_until(lambda who=who: f"goes on: {who} answers again" in lines)
        (tmp_path / "go").touch()
        assert run.result(60)["waits"] == ("waits", "")
        assert heard == [("waits", 1.0)]

        os.kill(worker, signal.SIGSTOP)  # a new run does not begin
        monkeypatch.setattr(dask_cluster, "ANSWER_S", 2.0)
        problem = refusal(done, [Square(1)], cluster=cluster)
        assert_says(problem, f"1 of 1 worker of the scheduler at {address} gave no answer within 2 s: {name} | wake or")
        assert nanny.poll() is None


@pytest.mark.slow
def test_the_job_of_a_worker_that_does_not_wake_is_given_to_another(tmp_path, monkeypatch, frequent_looks):
    monkeypatch.setattr(silence, "TELL_AFTER_S", 1.0)
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL", "2s")
    with (
        scheduler_process(tmp_path) as (_, address),
        worker_processes(tmp_path, address),
        ThreadPoolExecutor(1) as thread,
    ):
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        lines = []
        cluster = Cluster(address, tmp_path, writes=True)
        run = thread.submit(done, [Waits(tmp_path)], cluster=cluster, notify=lines.append)
        wait_until((tmp_path / "pid").exists)
        os.kill(int((tmp_path / "pid").read_text()), signal.SIGSTOP)
        (tmp_path / "go").touch()
        assert run.result(90)["waits"] == ("waits", "")
        assert any(line.startswith("waiting: the worker ") for line in lines)
        again = next(line for line in lines if line.startswith("again: waits (its worker "))
        assert again.endswith("was silent for too long)")
