"""Scenes whose code exits, crashes, hangs or spoils its process: each costs itself alone, in one line."""

import shutil

import pytest
from small_dataset import SCENES, SMALL_RECIPE

from saf_gen.core.execution import silence

FAILS = {
    "exits": ("import sys; sys.exit(3)", "called exit(3)"),
    "ends_itself": ("import os; os._exit(0)", "died twice during its build (it ended with exit code 0)"),
    "reads_nothing": (
        "import ctypes; ctypes.string_at(0)",
        "died twice during its build (it was ended by signal 11 (SIGSEGV))",
    ),
    "aborts": ("import os; os.abort()", "died twice during its build (it was ended by signal 6 (SIGABRT))"),
    "is_terminated": (
        "import os, signal; os.kill(os.getpid(), signal.SIGTERM)",
        "died twice during its build (it was ended by signal 15 (SIGTERM))",
    ),
    "is_killed": (
        "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
        "died twice during its build (it was ended by signal 9 (SIGKILL, as where memory runs out))",
    ),
    "closes_all": ("import os; os.closerange(0, 256)", "died twice during its build (it closed its line"),
    "stops_a_generator": ("raise GeneratorExit", "raised GeneratorExit"),
    "raises_its_own": ("class Mine(BaseException): pass\n    raise Mine('!')", "raised Mine: !"),
    "interrupts": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "goes_deep": ("deep = lambda n: deep(n + 1)\n    deep(0)", "RecursionError"),
    "allocates": ("bytearray(1 << 60)", "MemoryError"),
}
"""What ``build()`` does first, and what its line says."""
WORKS = {
    "closes_streams": "import os\n    for n in range(3): os.close(n)",
    "hides_streams": "import sys; sys.stdout = sys.stderr = None",
    "moves": "import os; os.chdir('/')",
    "loses_its_folder": "import os, tempfile; d = tempfile.mkdtemp(); os.chdir(d); os.rmdir(d)",
    "lowers_the_limit": "import sys; sys.setrecursionlimit(90)",
    "forks": "import os; os.fork()",
    "clears_the_environment": "import os; os.environ.clear()",
    "exits_at_the_end": "import atexit, os; atexit.register(lambda: os._exit(7))",
    "never_lets_go": "import threading, time; threading.Thread(target=time.sleep, args=(600,)).start()",
}
"""What ``build()`` does before it returns a good scene."""


def write_scene(folder, name, code):
    """Write the chequered plane as a scene whose ``build()`` runs ``code`` first."""
    shutil.copytree(SCENES / "plane", folder / name)
    card, script = folder / name / "scene.yaml", folder / name / "scene.py"
    card.write_text(card.read_text().replace("id: plane", f"id: {name}"))
    script.write_text(script.read_text().replace("def build(params):\n", f"def build(params):\n    {code}\n"))


@pytest.fixture
def scenes(tmp_path, monkeypatch, worker_processes):
    """A folder of scenes that all break in their own way, and a good one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))
    broken = {name: code for name, (code, _) in FAILS.items()}
    for name, code in {**broken, **WORKS, "plane": "pass"}.items():
        write_scene(tmp_path / "scenes", name, code)
    return tmp_path / "scenes"


def is_named(name, line):
    """Return whether a line says what a scene did; of files that are closed, a reader of one may speak first."""
    return FAILS[name][1] in line or (name == "closes_all" and "closed files that it did not open" in line)


@pytest.mark.daily(1)
@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_each_scene_that_breaks_costs_itself_alone(scenes, call, tmp_path, workers):
    """Half of the scenes are rendered beside one recording at a time, and half beside two."""
    fails, works = list(FAILS)[workers - 1 :: 2], [*list(WORKS)[workers - 1 :: 2], "plane"]
    names = [*fails, *works]
    recipe = SMALL_RECIPE.replace("[plane]", f"[{', '.join(names)}]").replace(", continuous, lamp_only", "")
    (tmp_path / "many.yaml").write_text(recipe)
    how = ("--out", "made", "--variant", "scalar", "--workers", workers)
    code, out, err = call("generate", "many.yaml", *how)
    lines = [line for line in err.splitlines() if not line.startswith(("done: ", "again: ", "waiting: "))]
    assert code == 1
    assert f"{len(works)} sequences recorded" in out
    assert sorted(path.stem for path in (tmp_path / "made/test").iterdir()) == sorted(
        f"{name}-constant-00" for name in works
    )
    assert len(lines) == len(fails)
    for name in fails:
        (line,) = (line for line in lines if line.startswith(f"saf-gen: render {name} failed: "))
        assert is_named(name, line)


@pytest.mark.daily(2)
@pytest.mark.slow
@pytest.mark.parametrize("name", ["exits", "ends_itself", "reads_nothing", "closes_all", "raises_its_own"])
def test_a_check_or_preview_of_a_scene_that_breaks_is_one_line(scenes, call, name):
    code, out, err = call("scenes", "check", name, "--variant", "scalar")
    lines = [line for line in out.splitlines() if " error " in line]
    assert (code, len(lines)) == (1, 1)
    assert lines[0].startswith(f"{name} error ")
    assert is_named(name, lines[0])
    assert not [line for line in err.splitlines() if not line.startswith(("again: ", "waiting: "))]
    code, out, err = call("scenes", "preview", name, "--variant", "scalar")
    (line,) = (line for line in err.splitlines() if not line.startswith(("again: ", "waiting: ")))
    assert code in (1, 2)
    assert line.startswith("saf-gen: ")
    assert name in line
    assert is_named(name, line)
    assert not (scenes / name / "preview.png").exists()


@pytest.mark.slow
def test_a_scene_whose_build_does_not_end_is_told_and_ends_with_the_run(scenes, tmp_path, monkeypatch, capfd):
    from saf_gen.authoring.jobs import CheckSceneJob, run_scene_jobs
    from saf_gen.camera import get_sensor
    from saf_gen.scene.scene_folder import find_scene

    write_scene(scenes, "loops", "while True: pass")
    monkeypatch.setattr(silence, "TELL_AFTER_S", 0.5)

    class Told(Exception):
        pass

    def notify(line):
        if " · " in line:  # its process has started
            raise Told(line)

    job = CheckSceneJob(find_scene("loops"), get_sensor("vidar_400x250"), "scalar")
    with pytest.raises(Told, match="waiting: check loops · build has said nothing for "):
        list(run_scene_jobs([job], lambda name, done: None, notify=notify))
    assert capfd.readouterr().err == ""
