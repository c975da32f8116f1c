"""Checks and contact sheets of scenes as jobs, which run in a process of their own: a scene's code may end its process.

Only that process loads the renderer.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

from saf_gen.camera import Sensor
from saf_gen.core.execution import Cluster, JobResult, ReportProgress, run_jobs
from saf_gen.core.extras import RENDERER, require_extra
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
        from saf_gen.authoring.checks import check_scene

        report(f"{self.name} · build", 0.0)
        findings = check_scene(
            self.scene, self.sensor, backend=self.backend, progress=lambda done: report(self.name, done)
        )
        return tuple(findings)


@dataclass(frozen=True)
class PreviewJob:
    """Draws the contact sheet of a scene to ``path``."""

    scene: Scene
    sensor: Sensor
    path: Path
    backend: str
    takes_all_cores = True
    wants_gpu = True

    @property
    def name(self) -> str:
        return f"preview {self.scene.id}"

    def run(self, report: ReportProgress) -> None:
        from saf_gen.authoring.scene_sheet import preview_scene

        report(f"{self.name} · build", 0.0)
        preview_scene(
            self.scene, self.sensor, path=self.path, backend=self.backend, progress=lambda done: report(self.name, done)
        )


def run_scene_jobs(
    jobs: Sequence[CheckSceneJob | PreviewJob],
    report: ReportProgress,
    *,
    cluster: str | None = None,
    notify: Callable[[str], None] = lambda line: None,
) -> Generator[JobResult]:
    """Run jobs one after the other, or on the workers of a cluster, which must see the folders of the scenes.

    See :func:`saf_gen.core.execution.run_jobs`; ``cluster`` is the address of a Dask scheduler.
    """
    if cluster is None:
        require_extra("render", *RENDERER, of="rendering")
    machines = Cluster(cluster, jobs[0].scene.folder / "scene.yaml") if cluster and jobs else None
    return run_jobs(jobs, workers=1, report=report, cluster=machines, notify=notify)
