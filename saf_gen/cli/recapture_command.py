"""The command ``recapture``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saf_gen.cli._terminal import out, print_error, progress_bars, terminal_reporter
from saf_gen.cli.command import FINISHED_WORK_IS_KEPT, Command, Panel
from saf_gen.core.files import DiskFull
from saf_gen.core.plain_text import plural
from saf_gen.errors import escape_controls, unknown

if TYPE_CHECKING:
    from saf_gen.stack.recapture import Recapture
    from saf_gen.stream.manifest import Manifest, SequenceEntry


def recapture_command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder with its stacks, or its name.")],
    *,
    sensor: Annotated[
        str, typer.Option(help="Sensor of another kind than spikes (saf-gen sensors list), or path of its .yaml file.")
    ] = "davis346",
    folder: Annotated[
        Path | None,
        typer.Option("--out", help="Folder to write to (default: DATASET/cameras/SENSOR or sample-SENSOR)."),
    ] = None,
    split: Annotated[str | None, typer.Option(help="Record only this split.")] = None,
    sequence: Annotated[list[str] | None, typer.Option(help="Record only this sequence; repeatable.")] = None,
    exposure_us: Annotated[
        float | None,
        typer.Option(
            help="Exposure of each frame (default: until the target detects a photon in half of the frames, or fills "
            "half of its well; at most a frame)."
        ),
    ] = None,
) -> None:
    """Record a dataset again with another camera.

    Scene, lens, light and truth are the same; the sensor is another.
    """
    from saf_gen.stack.recapture import CAMERAS, Recapture
    from saf_gen.stream.manifest import read_manifest
    from saf_gen.stream.sample_dataset import SAMPLE, find_data, sample

    dataset = find_data(dataset)
    of_sample = dataset == sample()
    camera, manifest = Recapture.by(sensor, exposure_us=exposure_us), read_manifest(dataset)
    if split is not None and split not in manifest.splits:
        raise unknown("split", split, allowed=manifest.splits, where=str(dataset))
    entries = [entry for entry in manifest.sequences if split in (None, entry.split)]
    for name in sequence or ():
        if name not in [entry.id for entry in entries]:
            raise unknown("sequence", name, allowed=[entry.id for entry in entries], where=str(dataset))
    entries = [entry for entry in entries if not sequence or entry.id in sequence]
    target = folder or (Path(f"{SAMPLE}-{camera.name}") if of_sample else dataset / CAMERAS / camera.name)
    record_with(camera, dataset, manifest=manifest, entries=entries, target=target)


def record_with(
    camera: "Recapture", dataset: Path, *, manifest: "Manifest", entries: "list[SequenceEntry]", target: Path
) -> None:
    """Record sequences with another camera, and print what was made; raise typer.Exit(1) if one of them failed."""

    def tell(line: str) -> None:
        out.print(escape_controls(line), soft_wrap=True, markup=False)

    with progress_bars() as bars:
        report = terminal_reporter(f"record with {camera.name}", bars)
        done = camera.record_all(dataset, entries, target=target, report=report, tell=tell)
    for name, error in done.failed.items():
        if isinstance(error, DiskFull):
            raise error  # the others have failed alike
        print_error(f"{name}: {error}", 1)
    kept = f", {done.kept} kept" if done.kept else ""
    tell(f"{plural(done.made, 'sequence')} recorded with {camera.name}{kept}: {target}")
    if next_command := camera.finish(dataset, manifest, target=target):
        tell(f"next: {next_command}")
    if done.failed:
        raise typer.Exit(1)


COMMANDS = {
    "recapture": Command(
        recapture_command,
        (
            "recapture datasets/quickstart --sensor davis346",
            "recapture datasets/quickstart --sensor swissspad3 --out elsewhere",
        ),
        Panel.GENERATE,
        FINISHED_WORK_IS_KEPT,
    )
}
"""The commands of this file, by the words that call them."""
