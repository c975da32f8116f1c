"""Fixtures that all tests share: scenes, a small sensor, small datasets, and servers on this machine."""

import fcntl
import gc
import importlib
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import own_cores  # noqa: F401, first, because libraries count the cores when they are imported
import pytest
from inline_jobs import run_jobs_inline
from processor_time import ProcessorTime
from small_dataset import HERE, SCENES, SMALL_RECIPE

from saf_gen.authoring import jobs
from saf_gen.cli import _terminal, main
from saf_gen.core.config import registry
from saf_gen.core.cores import usable_cores
from saf_gen.core.execution import run_jobs
from saf_gen.generate import run
from saf_gen.scene.trusted_folders import register_folder

_terminal.out.width = 400  # tables of commands that tests call have all columns

WORKERS = 8
"""Largest number of processes of a complete test run; each needs about a gigabyte of memory."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add options: a variant of Mitsuba, a file of processor times, and whether pages are rewritten."""
    parser.addoption("--variant", choices=["llvm", "cuda", "scalar"], help="variant that renders in tests")
    parser.addoption("--accept", action="store_true", help="write what is printed to the pages that show it")
    parser.addoption("--processor-times", type=Path, metavar="FILE", help="add each test's processor seconds")


def pytest_configure(config: pytest.Config) -> None:
    """Tell the helpers of tests, which are imported later, also by commands that tests start."""
    if variant := config.getoption("variant"):
        os.environ["SAF_GEN_TEST_VARIANT"] = variant
    table = None if hasattr(config, "workerinput") else config.getoption("processor_times")
    config.pluginmanager.register(ProcessorTime(table))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Use one process for a few files, which starts sooner, and one per core for folders."""
    if all(Path(name.partition("::")[0]).suffix == ".py" for name in config.args):
        return 0
    return min(usable_cores(), WORKERS)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave most cases of a test that is marked ``daily`` to the night, and put the renderer's tests first.

    The cases that run daily are spread evenly. Renders come first, so that one process compiles their kernels while
    others run other tests: each process starts with a different section of this order.
    """
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("daily") and not item.get_closest_marker("long"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for of_test in cases.values():
        (count,) = of_test[0].get_closest_marker("daily").args
        daily = {n * len(of_test) // count for n in range(count)}
        for n, item in enumerate(of_test):
            if n not in daily:
                item.add_marker("long")
    items.sort(key=lambda item: HERE / "render" not in item.path.parents)


def pytest_collection_finish() -> None:
    """Exclude libraries and tests, which stay until the end, from garbage collection."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _jobs_in_this_process():
    """Generate datasets and check scenes in this process, unless a test uses the fixture `worker_processes`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "run_jobs", run_jobs_inline)
        patch.setattr(jobs, "run_jobs", run_jobs_inline)
        yield


@pytest.fixture(scope="session", autouse=True)
def _empty_contact_sheets():
    """Make contact sheets of datasets empty files, because drawing them takes longer than rendering a small stack.

    Commands that run in another process still draw them.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("saf_gen.authoring.contact_sheet.write_preview", _write_empty_sheet)
        yield


def _write_empty_sheet(stack, sensor, *, path):
    path.parent.mkdir(exist_ok=True)
    path.touch()


@pytest.fixture(scope="session", autouse=True)
def _folders_of_the_user(tmp_path_factory):
    """Replace the user's registered folders and kept results by empty ones, also for commands that tests start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def worker_processes(monkeypatch):
    """Let generate() and the commands on scenes start worker processes, as they do for a user."""
    monkeypatch.setattr(run, "run_jobs", run_jobs)
    monkeypatch.setattr(jobs, "run_jobs", run_jobs)


@pytest.fixture(scope="module")
def cluster_address() -> Iterator[str]:
    """Address of a Dask scheduler in a thread of this process, with a plain worker and one that offers a GPU.

    It polls the machine many times a second, so it is closed after the module's last test.
    """
    import distributed

    workers = {
        name: {"cls": distributed.Worker, "options": {"nthreads": 1, "resources": resources}}
        for name, resources in (("plain", {}), ("card", {"GPU": 1}))
    }
    scheduler = {"cls": distributed.Scheduler, "options": {"dashboard": False, "dashboard_address": ":0"}}
    with distributed.SpecCluster(workers, scheduler=scheduler, silence_logs="CRITICAL") as made:
        yield made.scheduler_address


@pytest.fixture
def test_scenes(monkeypatch):
    """Add tests/scenes to the folders in which scenes are found."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(SCENES))
    return SCENES


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """An empty working directory whose scenes/ is registered."""
    monkeypatch.chdir(tmp_path)
    register_folder(tmp_path / "scenes")
    return tmp_path


@pytest.fixture
def register() -> Iterator[Callable[[str, str, object], None]]:
    """Return a function ``(kind, name, part)`` that registers a plug-in under a name until the test ends."""
    added = []

    def add(plugin_kind: str, name: str, part: object) -> None:
        registry.add_plugin(plugin_kind, part, name=name)
        added.append((plugin_kind, name))

    yield add
    for plugin_kind, name in added:
        registry._registered_here[plugin_kind].pop(name, None)


@pytest.fixture
def forget_packages() -> Iterator[Callable[[], None]]:
    """Return a function that lets the registry look anew for installed packages, as it does after the test."""

    def forget() -> None:
        importlib.invalidate_caches()
        registry._entry_points.cache_clear()
        registry._find_plugin_class.cache_clear()

    yield forget
    forget()


@pytest.fixture
def small_sensor() -> Path:
    """A sensor file like vidar_400x250, but with 64×40 pixels of 60 µm."""
    return HERE / "small_sensor.yaml"


@pytest.fixture
def small_recipe(tmp_path) -> Path:
    """A recipe that takes seconds to generate: the chequered plane, three lights, 400 frames."""
    path = tmp_path / "small.yaml"
    path.write_text(SMALL_RECIPE)
    return path


@pytest.fixture(scope="session")
def captured_dataset(tmp_path_factory) -> Path:
    """A dataset of 40 ms that can be captured again, with two still and two moving sequences; read-only."""
    return make_captured_dataset(tmp_path_factory, "captured")


@pytest.fixture(scope="session")
def half_captured_dataset(tmp_path_factory) -> Path:
    """`captured_dataset` with whole slices, next to the others, for half of the 40 ms only; read-only."""
    return make_captured_dataset(
        tmp_path_factory, "half_captured", changes=("whole_slices: true", "whole_slices: 0.02")
    )


def make_captured_dataset(factory: pytest.TempPathFactory, name: str, changes: tuple[str, str] = ("", "")) -> Path:
    """Make the dataset of capture_dataset.py, or wait until another test process has done so; return its folder."""
    import capture_dataset  # here, because importing it probes the renderers

    shared = factory.getbasetemp()
    shared = shared.parent if "PYTEST_XDIST_WORKER" in os.environ else shared
    with (shared / f"{name}.lock").open("a") as lock, pytest.MonkeyPatch.context() as patch:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / f"{name}.made").exists():
            (shared / name).mkdir()
            capture_dataset.make_dataset(shared / name, patch, capture_dataset.RECIPE.replace(*changes))
            (shared / f"{name}.made").touch()
    return shared / name / "takes"


@pytest.fixture
def readable_figures(monkeypatch) -> Iterator[None]:
    """Fail the test if it saves a figure in which texts overlap or are cut off by a side."""
    from figure_texts import overlapping_texts
    from matplotlib.backend_bases import FigureCanvasBase

    found, save = [], FigureCanvasBase.print_figure

    def check(canvas, *arguments, **options):
        result = save(canvas, *arguments, **options)
        found.extend(overlapping_texts(canvas.figure))
        return result

    monkeypatch.setattr(FigureCanvasBase, "print_figure", check)
    yield
    assert found == []


@pytest.fixture
def call(capsys) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs saf-gen in this process and returns (exit code, stdout, stderr).

    Lines of progress are left out of stderr unless they are asked for with ``progress=True``.
    """

    def run_command(*arguments: object, progress: bool = False) -> tuple[int, str, str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        # A busy machine may be at work for long.
        steps = "" if progress else r"|^(evaluate|rank|scenes|tune|verify) \d+%: .*\n"
        left_out = r"^\w+: at work for \d+ s\n" + steps
        return ended.value.code, out, re.sub(left_out, "", err, flags=re.MULTILINE)

    return run_command
