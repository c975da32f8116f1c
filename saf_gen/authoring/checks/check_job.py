"""The checks of one scene, as a job that may run on another machine."""

from dataclasses import dataclass

from saf_gen.authoring.checks import check_scene
from saf_gen.camera import Sensor
from saf_gen.core.execution import ReportProgress
from saf_gen.core.finding import Finding
from saf_gen.scene.scene_folder import Scene


@dataclass(frozen=True)
class CheckSceneJob:
    """Checks a scene and returns all findings at once."""

    scene: Scene
    sensor: Sensor
    backend: str
    takes_all_cores = True

    @property
    def name(self) -> str:
        return f"check {self.scene.id}"

    @property
    def wants_gpu(self) -> bool:
        return self.backend in ("auto", "cuda")

    def run(self, report: ReportProgress) -> tuple[Finding, ...]:
        return tuple(check_scene(self.scene, self.sensor, backend=self.backend))
