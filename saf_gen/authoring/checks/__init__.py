"""Checks of a scene: each examines one aspect, and reports in one line what it found and what to do.

>>> for finding in check_scene(find_scene("camel"), get_sensor("vidar_400x250")):  # doctest: +SKIP
...     print(finding.level, finding.text)
"""

from collections.abc import Callable, Iterator

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_error, scene_check_ok
from saf_gen.authoring.checks.focus_reach import check_family, check_reach, out_of_reach
from saf_gen.authoring.checks.licence import check_licence
from saf_gen.authoring.checks.picture_grain import check_grain
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.authoring.checks.scene_units import check_units
from saf_gen.authoring.checks.sharpness_curve import check_curve
from saf_gen.authoring.checks.slice_interpolation import check_slices
from saf_gen.authoring.checks.target_detail import check_detail
from saf_gen.authoring.checks.target_illuminance import check_exposure
from saf_gen.authoring.checks.target_motion import check_motion
from saf_gen.camera import Sensor
from saf_gen.errors import BadInput
from saf_gen.scene.scene_folder import Scene

__all__ = [
    "SceneFinding",
    "SceneUnderTest",
    "check_curve",
    "check_detail",
    "check_exposure",
    "check_family",
    "check_grain",
    "check_motion",
    "check_reach",
    "check_scene",
    "check_slices",
    "check_units",
]

CHECKS_OF_BUILT_SCENES: tuple[Callable[[SceneUnderTest], Iterator[SceneFinding]], ...] = (
    check_units,
    check_reach,
    check_exposure,
    check_detail,
    check_curve,
    check_motion,
    check_slices,
    check_grain,
    check_family,
)


def check_scene(
    scene: Scene, sensor: Sensor, *, backend: str = "auto", progress: Callable[[float], None] = lambda done: None
) -> Iterator[SceneFinding]:
    """Yield the findings of all checks as they are made.

    If a check cannot be completed, for example because the scene cannot be built, its finding is an error, and checks
    that need its result do not run.

    Parameters
    ----------
    scene : Scene
        Scene to check.
    sensor : Sensor
        Sensor for which the scene is checked.
    backend : {'auto', 'cuda', 'llvm', 'scalar'}, default 'auto'
        Backend of the renderer.
    progress : callable, optional
        Called with the fraction done, 0 to 1.

    Yields
    ------
    SceneFinding
    """
    yield from check_licence(scene)
    subject = SceneUnderTest(scene, sensor, backend=backend)
    try:
        shapes = subject.renderer.prepare().mitsuba_scene.shapes()
        yield scene_check_ok("geometry", f"{len(shapes)} shapes, light groups {', '.join(scene.card.lights)}")
    except BadInput as problem:
        yield scene_check_error("geometry", str(problem))
        return
    progress(0.1)
    try:
        subject.true_focus  # noqa: B018
    except BadInput as problem:
        yield out_of_reach(subject, problem)
        return
    for n, check in enumerate(CHECKS_OF_BUILT_SCENES, 1):
        try:
            yield from check(subject)
        except BadInput as problem:
            yield scene_check_error(check.__name__.removeprefix("check_scene_"), str(problem))
        progress(0.1 + 0.9 * n / len(CHECKS_OF_BUILT_SCENES))
