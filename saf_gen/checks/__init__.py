"""Checks of a scene: each looks at one thing, and says in one line what it found and what to do.

for finding in check_scene(find_scene("camel"), get_sensor("vidar_400x250")): ...
"""

from collections.abc import Callable, Iterator

from saf_gen.camera import Sensor
from saf_gen.checks._finding import Finding, error, ok
from saf_gen.checks.curve import check_curve
from saf_gen.checks.detail import check_detail
from saf_gen.checks.exposure import check_exposure
from saf_gen.checks.motion import check_motion
from saf_gen.checks.paper import check_paper
from saf_gen.checks.reach import check_family, check_reach, unseen
from saf_gen.checks.slices import check_slices
from saf_gen.checks.trial import Trial
from saf_gen.checks.units import check_units
from saf_gen.errors import BadInput
from saf_gen.scene import Scene

__all__ = [
    "Finding",
    "Trial",
    "check_curve",
    "check_detail",
    "check_exposure",
    "check_family",
    "check_motion",
    "check_reach",
    "check_scene",
    "check_slices",
    "check_units",
]

SEEN: tuple[Callable[[Trial], Iterator[Finding]], ...] = (
    check_units,
    check_reach,
    check_exposure,
    check_detail,
    check_curve,
    check_motion,
    check_slices,
    check_family,
)


def check_scene(
    scene: Scene,
    sensor: Sensor,
    *,
    variant: str = "auto",
    progress: Callable[[float], None] = lambda done: None,
) -> Iterator[Finding]:
    """Findings of all checks, one after the other as they are made; ``progress`` is told the share done.

    What stops one check (a scene that cannot be built, a target out of sight) is an error of that check, and
    ends those that need it.
    """
    yield from check_paper(scene)
    trial = Trial(scene, sensor, variant)
    try:
        yield ok("geometry", _built(trial))
    except BadInput as problem:
        yield error("geometry", str(problem))
        return
    progress(0.1)
    try:
        trial.truth  # noqa: B018
    except BadInput as problem:
        yield unseen(trial, problem)
        return
    for n, check in enumerate(SEEN, 1):
        try:
            yield from check(trial)
        except BadInput as problem:
            yield error(check.__name__.removeprefix("check_"), str(problem))
        progress(0.1 + 0.9 * n / len(SEEN))


def _built(trial: Trial) -> str:
    shapes = trial.studio.setup().world.shapes()
    return f"{len(shapes)} shapes, light groups {', '.join(trial.scene.card.lights)}"
