"""What a live camera looks at: a recording of a dataset, or a scene, which is rendered once and kept."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

from saf_gen import __version__
from saf_gen.benchmark.tracks.tasks import check_stream, select_sequences_to_evaluate
from saf_gen.core.execution import ReportProgress
from saf_gen.core.files import write_text
from saf_gen.generate.plan import make_plan
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import run_plan
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.capture import Capture
from saf_gen.stream.sample_dataset import is_sample, sample
from saf_gen.stream.stream_file import open_stream

SENSOR = "vidar_400x250"
SAMPLES = 64
POSITIONS = 65
RECIPE = """\
name: live
seed: 1
camera: {{sensor: {sensor}, frames: 16, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: {positions}}}
render: {{samples: {samples}}}
lights: {{constant: {{kind: constant}}}}
splits: {{live: {{scenes: [{scene}], lights: [constant]}}}}
"""


def open_capture(
    source: str | Path,
    *,
    sensor: str = SENSOR,
    samples: int = SAMPLES,
    report: ReportProgress = lambda name, done: None,
    tell: Callable[[str], None] = lambda line: None,
) -> Capture:
    """Return what a live camera looks at.

    Parameters
    ----------
    source : str or Path
        A dataset folder, whose first recording is taken, or ``sample``; a stream of a dataset; or the name of a scene.
        The scene is rendered at rest, and kept in the user's cache folder. All others need no renderer.
    sensor : str, default 'vidar_400x250'
        Name or file of the sensor in front of a scene; a recording has its own.
    samples : int, default 64
        Smallest number of light paths per pixel and position of a scene's stack.
    report : callable, optional
        Called with the name of a job and the fraction of it that is done, while a scene is rendered.
    tell : callable, optional
        Called with a line for the user.

    Raises
    ------
    BadInput
        If there is no such dataset, stream or scene, if the focal stacks of a recording are missing, or if a scene
        cannot be rendered here.
    """
    path = sample() if is_sample(source) else Path(source)
    if not (path.exists() or path.suffix == ".h5" or path.name != str(source)):
        path = _render(str(source), sensor=sensor, samples=samples, report=report, tell=tell)
    task = select_sequences_to_evaluate(path, split="all" if path.is_dir() else None).tasks[0]
    with open_stream(task.path) as stream:
        check_stream(task, stream)
        return Capture.from_stream(stream, Path(str(task.path)).parent.parent / "stacks")


def _render(scene: str, *, sensor: str, samples: int, report: ReportProgress, tell: Callable[[str], None]) -> Path:
    """Return the folder of a dataset of one scene, made now unless an earlier call has made it."""
    find_scene(scene)
    state = __version__.encode()
    if Path(sensor).is_file():
        sensor = str(Path(sensor).resolve())
        state += Path(sensor).read_bytes()
    text = RECIPE.format(scene=scene, sensor=json.dumps(sensor), samples=samples, positions=POSITIONS)
    folder = _cache() / f"{scene}-{hashlib.sha256(text.encode() + state).hexdigest()[:8]}"
    recipe = folder.with_suffix(".yaml")
    write_text(recipe, text)
    plan = make_plan(resolve_recipe(recipe), folder)
    if plan.manifest is not None and plan.manifest.sequences and not (plan.to_render or plan.unrecorded):
        return folder  # at once: a run would start processes to find that there is nothing to do
    if plan.to_render:
        tell(f"rendering the focal stack of {scene}, which is kept in {folder}")
    result = run_plan(plan, report=report, tell=tell)
    for problem in result.failed.values():
        raise problem
    return folder


def _cache() -> Path:
    """Return the folder in which rendered scenes are kept, which need not exist."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    return Path(stated if Path(stated).is_absolute() else os.path.expanduser("~/.cache")) / "saf_gen" / "live"  # noqa: PTH111
