"""Check that a scene is the same in another process, in which ``hash()`` of a text and the order of sets are others.

Run as a program, this module builds the scene that it reads from standard input once more.
"""

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from saf_gen.authoring.checks.subject import SceneUnderTest
from saf_gen.core.finding import Finding
from saf_gen.errors import BadInput
from saf_gen.stack.same_scene import HINT, is_same

MOST_SECONDS = 1800
SEED = "PYTHONHASHSEED"


def check_repeat(subject: SceneUnderTest) -> Iterator[Finding]:
    """Build the scene in a second process, without rendering it, and compare what the script returns."""
    again = _build_elsewhere(subject)
    if isinstance(again, str):
        yield Finding("repeat", "error", f"built once, but not in a second process: {again}")
    elif not is_same(subject.renderer.sums, again):
        yield Finding("repeat", "error", f"not the same scene in a second process: {HINT}")
    else:
        yield Finding("repeat", "ok", "the same in a second process")


def _build_elsewhere(subject: SceneUnderTest) -> list[float] | str:
    """Return the sums of the scene in another process, or why there are none."""
    seed = os.environ.get(SEED, "")
    other_seed = str((int(seed) + 1) % 2**32) if seed.isdecimal() else "1"
    with tempfile.TemporaryDirectory(prefix="saf-gen-scene-") as folder:
        answer = Path(folder) / "answer.json"
        try:
            ended = subprocess.run(
                [sys.executable, "-P", "-m", __name__],
                input=pickle.dumps((subject.scene, subject.sensor, subject.backend, answer)),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, SEED: other_seed},
                timeout=MOST_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"it takes more than {MOST_SECONDS} s there"
        if not answer.exists():
            return f"its process ended with exit code {ended.returncode}"
        said: list[float] | str = json.loads(answer.read_text())
        return said


def _answer() -> None:
    scene, sensor, backend, path = pickle.load(sys.stdin.buffer)
    said: tuple[float, ...] | str
    try:
        said = SceneUnderTest(scene, sensor, backend=backend).renderer.sums
    except BadInput as problem:
        said = str(problem)
    path.write_text(json.dumps(said))
    os._exit(0)  # threads of the script may never end


if __name__ == "__main__":
    _answer()
