"""The commands ``scenes list``, ``show``, ``new``, ``from-pictures``, ``check`` and ``preview``."""

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from saf_gen.cli._tables import print_facts, print_json, print_table
from saf_gen.cli._terminal import (
    LEVEL_STYLES,
    AsJson,
    ClusterAddress,
    Linear,
    Transfer,
    at_work,
    err,
    out,
    print_error,
    progress_bars,
    terminal_reporter,
)
from saf_gen.cli.command import Command, Panel
from saf_gen.core.table import Column, Table
from saf_gen.errors import MAX_NAMES, BadInput, SafGenError, escape_controls

if TYPE_CHECKING:
    from saf_gen.camera import Sensor
    from saf_gen.core.finding import Finding
    from saf_gen.scene.picture_card import PictureScene
    from saf_gen.scene.scene_folder import Scene

SENSOR = "vidar_400x250"
SHEETS = (".png", ".svg")
TITLE_WIDTH = 50
SensorName = Annotated[str, typer.Option("--sensor", help="Sensor by name, or its YAML file.")]
Variant = Annotated[str, typer.Option(help="Renderer: auto, cuda, llvm or scalar.")]


def list_scenes_command(
    *,
    trust: Annotated[
        Path | None, typer.Option(help="Folder of scenes whose scripts may run from now on; read them first.")
    ] = None,
    forget: Annotated[Path | None, typer.Option(help="Folder of scenes to trust no longer.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the scenes that are found by name, or trust the scripts of a folder of scenes first.

    Those that come with saf_gen are trusted, and no others. Scenes in ./scenes are found by name once it is trusted,
    and replace those of the same name.
    """
    from saf_gen.scene.scene_folder import find_any_scene, scene_names
    from saf_gen.scene.trusted_folders import forget_folder, register_folder

    if trust is not None and not trust.is_dir():
        raise BadInput("is no folder", where=str(trust), allowed="a folder that holds folders of scenes")
    for folder, change, words in (
        (trust, register_folder, "trusted from now on"),
        (forget, forget_folder, "not trusted"),
    ):
        if folder is not None:
            change(folder)
            err.print(escape_controls(f"{folder.resolve()}: {words}"), soft_wrap=True, markup=False)
    columns = [
        Column("scene", "id"),
        Column("title", "title", str if as_json else lambda title: shorten(title, TITLE_WIDTH, placeholder=" ...")),
        Column("light groups", "lights", ", ".join, detail=1),
        Column("licence", "licence", detail=2),
        Column("lens", "lens.summary", detail=3),
        Column("roles", lambda card: ", ".join(card.light_roles.values()), detail=4),
    ]
    cards = [find_any_scene(name).card for name in scene_names()]
    print_table(Table(columns, cards), where_to_find="saf-gen scenes show NAME has them", as_json=as_json)


def new_scene_command(
    name: Annotated[str, typer.Argument(help="Name of the scene: lower-case letters, digits and _.")],
    *,
    xml: Annotated[bool, typer.Option("--xml", help="Write the geometry as XML instead of a Python script.")] = False,
    exported: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Exported scene.xml or .glb with a camera to copy, or mesh (.obj, .ply, .glb, .gltf, .stl) to place;"
            " its card is written.",
        ),
    ] = None,
    camera: Annotated[
        str, typer.Option(help="With --from: camera of the file (default: the first with a perspective).")
    ] = "",
    target: Annotated[
        str, typer.Option(help="With --from: shape or node to be in focus (default: the middle of the picture).")
    ] = "",
) -> None:
    """Create a scene in ./scenes from a commented template that renders as it is.

    If ./scenes is empty or missing, it is trusted from then on, as by `saf-gen scenes list --trust scenes`.
    """
    from saf_gen.authoring.template import scene_from_export, scene_from_template

    root = Path("scenes")
    empty = not any(root.glob("*"))
    left_out: list[str] = []
    if exported is not None:
        if xml:
            raise BadInput("--xml and --from are both given", hint="leave --xml out: --from also takes a scene.xml")
        written = scene_from_export(exported, name, root=root, camera=camera, target=target, notify=left_out.append)
    elif target or camera:
        option = "target" if target else "camera"
        raise BadInput(f"--{option} is given without --from", hint=f"write the {option} of a template on its card")
    else:
        written = scene_from_template(name, root, kind="xml" if xml else "script")
    for line in [*_list_files(written), *left_out]:
        out.print(line, soft_wrap=True)
    from saf_gen.scene.xml import read_scene_xml

    if exported is not None and read_scene_xml(root / name / "scene.xml", {}).films:  # a mesh alone has no camera
        from saf_gen.authoring.import_check import compare_with_source

        try:
            with at_work("rendering the scene beside its source"):
                line = compare_with_source(root / name, camera=camera)
        except BadInput as refused:
            line = f"picture: not compared with Mitsuba's of scene.xml: {refused}"
        out.print(line, soft_wrap=True)
    _trust(root, empty=empty)
    out.print(
        f"next: saf-gen scenes check {name}; saf-gen scenes preview {name}; then write its licence into scene.yaml"
    )


def _list_files(paths: list[Path]) -> list[str]:
    """Return a line for each file, or for the folder of more than MAX_NAMES."""
    counts = Counter(path.parent for path in paths)
    lines = (f"{p.parent}: {n} files" if (n := counts[p.parent]) > MAX_NAMES else str(p) for p in paths)
    return list(dict.fromkeys(lines))


def _trust(root: Path, *, empty: bool) -> None:
    """Trust the folder of a new scene if it was empty before; else say how."""
    from saf_gen.scene.scene_folder import scene_roots
    from saf_gen.scene.trusted_folders import register_folder

    if root.resolve() in scene_roots():
        return
    if empty:
        register_folder(root)
        out.print(f"trusted: {root.resolve()}; saf-gen scenes list --forget scenes undoes it", soft_wrap=True)
    else:
        out.print("next: saf-gen scenes list --trust scenes, if you trust the code of all scenes there")


def from_pictures_command(
    pictures: Annotated[Path, typer.Argument(help="Folder of pictures, or a file with several, such as TIFF pages.")],
    *,
    name: Annotated[str, typer.Option(help="Name of the scene: lower-case letters, digits and _.")],
    licence: Annotated[str, typer.Option(help="SPDX identifier of the licence of the pictures.")],
    linear: Linear = False,
    transfer: Transfer = None,
    step_um: Annotated[
        float | None, typer.Option(help="Distance of the focus between two pictures, µm, if it is known.")
    ] = None,
    box: Annotated[
        tuple[int, int, int, int] | None,
        typer.Option(help="Left, top, columns and rows of the target in pixels (default: all)."),
    ] = None,
) -> None:
    """Make a scene in ./scenes of pictures at equal steps of the focus, which any recipe may then use.

    If ./scenes is empty or missing, it is trusted from then on, as by `saf-gen scenes list --trust scenes`.
    """
    from saf_gen.authoring.template import scene_from_pictures

    root = Path("scenes")
    empty = not any(root.glob("*"))
    made = scene_from_pictures(
        pictures, name, root=root, linear=linear, transfer=transfer, licence=licence, step_um=step_um, box=box
    )
    for path in made:
        out.print(str(path), soft_wrap=True)
    _trust(root, empty=empty)
    out.print(f"next: write its title and source into scene.yaml, and name {name} in a split of a recipe")


def check_scenes_command(
    names: Annotated[list[str] | None, typer.Argument(help="Names or folders of scenes (default: all).")] = None,
    *,
    sensor: SensorName = SENSOR,
    variant: Variant = "auto",
    cluster: ClusterAddress = None,
    as_json: AsJson = False,
) -> None:
    """Check scenes: geometry, units, focus range, light, detail, focus curve, motion, licence."""
    from saf_gen.camera import get_sensor
    from saf_gen.scene.picture_card import PictureScene
    from saf_gen.scene.scene_folder import scene_names

    camera = get_sensor(sensor)
    found: list[dict[str, str]] = []

    def add(scene: str, finding: dict[str, str]) -> None:
        found.append({"scene": scene, **finding})
        _print_finding(found[-1], as_json)

    scenes = []
    for name in names or scene_names():
        try:
            scene = _any_scene(name)
        except BadInput as problem:
            if names:
                raise
            add(name, {"check": "card", "level": "error", "text": str(problem)})
            continue
        if isinstance(scene, PictureScene):
            add(name, {"check": "card", "level": "ok", "text": "its pictures are given; recipes check reads them"})
        else:
            scenes.append(scene)
    for scene, finding in _check(scenes, camera, variant=variant, cluster=cluster):
        add(scene.id, {"check": finding.check, "level": finding.level, "text": finding.text})
    if as_json:
        print_json(found)
    if any(finding["level"] == "error" for finding in found):
        raise typer.Exit(1)


def _check(
    scenes: "list[Scene]", camera: "Sensor", *, variant: str, cluster: str | None
) -> "Iterator[tuple[Scene, Finding]]":
    """Yield the findings of each scene when its check has ended, in a process of this machine or on a worker.

    Workers need access to the folders of the scenes.
    """
    from saf_gen.authoring.jobs import CheckSceneJob, run_scene_jobs
    from saf_gen.core.finding import Finding

    jobs = [CheckSceneJob(scene, camera, variant) for scene in scenes]
    complete = 0
    with ExitStack() as undo, progress_bars() as bars:
        show = terminal_reporter("scenes", bars)

        def report(name: str, done: float) -> None:
            show(round(100 * (complete + done if cluster is None else complete)), 100 * len(jobs), name)

        ended = run_scene_jobs(jobs, report, cluster=cluster, notify=err.print)
        undo.enter_context(closing(ended))
        for job, result, error in ended:
            complete += 1
            report(job.name, 0.0)
            if isinstance(error, BadInput) and cluster is None:
                raise error
            for finding in (Finding("process", "error", str(error)),) if error else result:
                yield job.scene, finding


def _print_finding(finding: dict[str, str], as_json: bool) -> None:
    if not as_json:
        level = finding["level"]
        parts = (finding["scene"], " ", (level, LEVEL_STYLES[level]), f" {finding['check']}: {finding['text']}")
        out.print(Text.assemble(*parts), soft_wrap=True)


def show_scene_command(name: Annotated[str, typer.Argument(help="Name of a scene, or its folder.")]) -> None:
    """Show a scene's card: lens, lights and roles, target, parameters, motion, licence, and where its picture is."""
    scene = _any_scene(name)
    card, picture = scene.card, scene.folder / "preview.png"
    lux, rate = card.illuminance_lux, card.slices_per_s
    roles = card.light_roles.items()
    lights = (f"{light} ({role}, {lux[light]:g} lux)" if lux else f"{light} ({role})" for light, role in roles)
    facts = {
        "title": card.title,
        "lens": card.lens.summary,
        "lenses": ", ".join(card.lenses),
        "light groups": ", ".join(lights),
        "target": ", ".join(card.target),
        "parameters": "; ".join(f"{key} {_describe_range(value)}" for key, value in card.params.items()),
        "moves": f"{', '.join(card.motion) or 'yes'}, {rate:g} slices per second" if rate else "",
        "licence": card.licence,
        "source": " ".join(card.source.split()),
        "folder": str(scene.folder),
        "picture": str(picture)
        if picture.is_file()
        else f"none yet: saf-gen scenes preview {name}"
        if card.target
        else "",
    }
    print_facts({key: text for key, text in facts.items() if text}, title=card.id)


def preview_command(
    names: Annotated[list[str], typer.Argument(help="Names or folders of scenes.")],
    *,
    target: Annotated[
        Path | None,
        typer.Option(
            "--out", help="PNG or SVG (default: preview.png in the scene's folder); for several scenes, a folder."
        ),
    ] = None,
    sensor: SensorName = SENSOR,
    variant: Variant = "auto",
) -> None:
    """Draw contact sheets of scenes: images, depth, light groups, histogram, focus curves, family."""
    from saf_gen.authoring.jobs import PreviewJob, run_scene_jobs
    from saf_gen.camera import get_sensor

    scenes, camera = [_scene(name) for name in dict.fromkeys(names)], get_sensor(sensor)
    if len(scenes) > 1 and target and (target.suffix.lower() in SHEETS or target.is_file()):
        raise BadInput(
            f"--out {target} is one file for {len(scenes)} scenes", hint="give a folder, or one scene at a time"
        )
    paths = [
        scene.folder / "preview.png" if target is None else target if len(scenes) == 1 else target / f"{scene.id}.png"
        for scene in scenes
    ]
    jobs = [PreviewJob(scene, camera, path, variant) for scene, path in zip(scenes, paths, strict=True)]
    ended = failed = 0
    with progress_bars() as bars:
        task = bars.add_task(jobs[0].name, total=len(jobs))

        def report(name: str, done: float) -> None:
            bars.update(task, description=name, completed=ended + done)

        for job, _, error in run_scene_jobs(jobs, report, notify=err.print):
            ended += 1
            bars.update(task, completed=ended)
            if error is None:
                out.print(str(job.path), soft_wrap=True)
                continue
            problem = error if isinstance(error, BadInput) else SafGenError(f"scene {job.scene.id!r}: {error}")
            if len(jobs) == 1:
                raise problem
            failed += 1
            print_error(str(problem), 1)
    if failed:
        raise typer.Exit(1)


def _describe_range(value: Any) -> str:
    """Return the value of a parameter, or the range or choice from which members draw it."""
    match value:
        case {"choice": choices}:
            return "one of " + ", ".join(map(str, dict.fromkeys(choices)))
        case {"uniform": [low, high]}:
            return f"{low} to {high}"
        case {"log_uniform": [low, high]}:
            return f"{low} to {high} (log-uniform)"
    return str(value)


def _any_scene(name: str) -> "Scene | PictureScene":
    """Return a scene by its name, or by its folder if ``name`` is a path."""
    from saf_gen.scene.scene_folder import find_any_scene, load_any_scene

    folder = Path(name)
    return load_any_scene(folder) if folder.name != name and folder.is_dir() else find_any_scene(name)


def _scene(name: str) -> "Scene":
    """Return a scene to render by its name, or by its folder if ``name`` is a path."""
    from saf_gen.scene.scene_folder import rendered

    return rendered(_any_scene(name))


COMMANDS = {
    "scenes list": Command(list_scenes_command, ("scenes list", "scenes list --trust their/scenes"), Panel.SCENES),
    "scenes show": Command(show_scene_command, ("scenes show camel",), Panel.SCENES),
    "scenes new": Command(
        new_scene_command, ("scenes new my_scene", "scenes new my_scene --from exported/scene.xml"), Panel.SCENES
    ),
    "scenes from-pictures": Command(
        from_pictures_command,
        (
            "scenes from-pictures weave --name weave --licence MIT --transfer srgb",
            "scenes from-pictures exr --name cells --licence MIT",
        ),
        Panel.SCENES,
    ),
    "scenes check": Command(
        check_scenes_command, ("scenes check my_scene", "scenes check camel fan --json"), Panel.SCENES
    ),
    "scenes preview": Command(
        preview_command,
        ("scenes preview my_scene --out sheet.png", "scenes preview camel fan --out sheets"),
        Panel.SCENES,
    ),
}
"""The commands of this file, by the words that call them."""
