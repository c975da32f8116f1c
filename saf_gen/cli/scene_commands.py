"""The commands ``scenes list``, ``new``, ``check`` and ``preview``."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import TaskID
from rich.text import Text

from saf_gen.cli._tables import print_json, print_table
from saf_gen.cli._terminal import LEVEL_STYLES, AsJson, ClusterAddress, err, out, progress_bars
from saf_gen.core.cores import defer_interrupts
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.camera import Sensor
    from saf_gen.core.finding import Finding
    from saf_gen.scene.scene_folder import Scene

SENSOR = "vidar_400x250"
SensorName = Annotated[str, typer.Option("--sensor", help="Sensor by name, or its YAML file.")]
Variant = Annotated[str, typer.Option(help="Renderer: auto, cuda, llvm or scalar.")]


def list_scenes_command(*, as_json: AsJson = False) -> None:
    """List the scenes that are found by name."""
    from saf_gen.scene.scene_folder import find_scene, scene_names

    columns = [
        Column("scene", "id"),
        Column("title", "title", folds=True),
        Column("light groups", "lights", ", ".join, folds=True),
        Column("lens", "lens.summary", folds=True),
        Column("licence", "licence", detail=1),
    ]
    cards = [find_scene(name).card for name in scene_names()]
    print_table(Table(columns, cards), where_to_find="scenes/NAME/scene.yaml has them", as_json=as_json)


def new_scene_command(
    name: Annotated[str, typer.Argument(help="Name of the scene: lower-case letters, digits and _.")],
    *,
    xml: Annotated[bool, typer.Option("--xml", help="Write the geometry as XML instead of a Python script.")] = False,
    exported: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Exported scene.xml to copy, or mesh (.obj, .ply, .glb, .gltf, .stl) to place; its card is written.",
        ),
    ] = None,
) -> None:
    """Create a scene in ./scenes from a commented template that renders as it is.

    If ./scenes is empty or missing, it is registered as by `saf-gen init`.
    """
    from saf_gen.authoring.template import scene_from_export, scene_from_template
    from saf_gen.scene.scene_folder import scene_roots
    from saf_gen.scene.trusted_folders import register_folder

    root = Path("scenes")
    trusted = root.resolve() in scene_roots()
    empty = not any(root.glob("*"))
    left_out: list[str] = []
    if exported is not None:
        if xml:
            raise BadInput("--xml and --from are both given", hint="leave --xml out: --from also takes a scene.xml")
        written = scene_from_export(exported, name, root=root, notify=left_out.append)
    else:
        written = scene_from_template(name, root, kind="xml" if xml else "script")
    for line in [*map(str, written), *left_out]:
        out.print(line, soft_wrap=True)
    if empty and not trusted:
        register_folder(root)
        out.print(f"registered: {root.resolve()}; saf-gen init --forget undoes it", soft_wrap=True)
    elif not trusted:
        out.print("next: saf-gen init, if you trust the code of all scenes in ./scenes")
    out.print(
        f"next: saf-gen scenes check {name}; saf-gen scenes preview {name}; then write its licence into scene.yaml"
    )


def check_scenes_command(
    names: Annotated[list[str] | None, typer.Argument(help="Names or folders of scenes (default: all).")] = None,
    *,
    sensor: SensorName = SENSOR,
    variant: Variant = "auto",
    cluster: ClusterAddress = None,
    as_json: AsJson = False,
) -> None:
    """Check scenes: geometry, units, focus range, light, detail, focus curve, motion, licence."""
    with defer_interrupts():
        import saf_gen.authoring.checks  # noqa: F401  (the renderer must not be interrupted while it loads)
        from saf_gen.camera import get_sensor
    from saf_gen.scene.scene_folder import scene_names

    camera = get_sensor(sensor)
    found: list[dict[str, str]] = []

    def add(scene: str, finding: dict[str, str]) -> None:
        found.append({"scene": scene, **finding})
        _print_finding(found[-1], as_json)

    scenes = []
    for name in names or scene_names():
        try:
            scenes.append(_scene(name))
        except BadInput as problem:
            if names:
                raise
            add(name, {"check": "card", "level": "error", "text": str(problem)})
    findings = _check_here if cluster is None else partial(_check_on_cluster, address=cluster)
    for scene, finding in findings(scenes, camera, variant=variant):
        add(scene.id, {"check": finding.check, "level": finding.level, "text": finding.text})
    if as_json:
        print_json(found)
    if any(finding["level"] == "error" for finding in found):
        raise typer.Exit(1)


def _check_here(scenes: "list[Scene]", camera: "Sensor", *, variant: str) -> "Iterator[tuple[Scene, Finding]]":
    from saf_gen.authoring.checks import check_scene

    for scene in scenes:
        with progress_bars() as bars:
            task = bars.add_task(f"check {scene.id}", total=1.0)

            def advance(done: float, task: TaskID = task) -> None:
                bars.update(task, completed=done)

            for finding in check_scene(scene, camera, backend=variant, progress=advance):
                yield scene, finding


def _check_on_cluster(
    scenes: "list[Scene]", camera: "Sensor", *, variant: str, address: str
) -> "Iterator[tuple[Scene, Finding]]":
    """Yield the findings of each scene as workers return them; workers need access to the folders of the scenes."""
    from saf_gen.authoring.checks import CheckSceneJob
    from saf_gen.core.execution import Cluster, run_jobs
    from saf_gen.core.finding import Finding

    if not scenes:
        return
    machines = Cluster(address, scenes[0].folder / "scene.yaml")
    jobs = [CheckSceneJob(scene, camera, variant) for scene in scenes]
    with progress_bars() as bars:
        task = bars.add_task("check", total=len(jobs))
        for job, result, error in run_jobs(
            jobs, workers=1, report=lambda name, done: bars.update(task, advance=1), cluster=machines, notify=err.print
        ):
            for finding in (Finding("cluster", "error", str(error)),) if error else result:
                yield job.scene, finding


def _print_finding(finding: dict[str, str], as_json: bool) -> None:
    if not as_json:
        level = finding["level"]
        parts = (finding["scene"], " ", (level, LEVEL_STYLES[level]), f" {finding['check']}: {finding['text']}")
        out.print(Text.assemble(*parts), soft_wrap=True)


def preview_command(
    name: Annotated[str, typer.Argument(help="Name of a scene, or its folder.")],
    *,
    target: Annotated[
        Path | None, typer.Option("--out", help="PNG, PDF or SVG (default: preview.png in the scene's folder).")
    ] = None,
    sensor: SensorName = SENSOR,
    variant: Variant = "auto",
) -> None:
    """Draw a contact sheet of a scene: images, depth, light groups, histogram, focus curves, family."""
    with defer_interrupts():
        from saf_gen.authoring.scene_sheet import preview_scene
        from saf_gen.camera import get_sensor

    scene, camera = _scene(name), get_sensor(sensor)
    path = target or scene.folder / "preview.png"
    preview_scene(scene, camera, path=path, backend=variant)
    out.print(str(path), soft_wrap=True)


def _scene(name: str) -> "Scene":
    """Return a scene by its name, or by its folder if ``name`` is a path."""
    from saf_gen.scene.scene_folder import find_scene, load_scene

    folder = Path(name)
    return load_scene(folder) if folder.name != name and folder.is_dir() else find_scene(name)
