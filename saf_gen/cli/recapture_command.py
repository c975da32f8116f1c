"""The command ``recapture``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saf_gen.cli._terminal import out, print_error, progress_bars, terminal_reporter
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput, escape_controls, unknown

if TYPE_CHECKING:
    from saf_gen.stack.other_cameras import OtherCamera


def recapture_command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder with its stacks.")],
    *,
    sensor: Annotated[
        str,
        typer.Option(
            help="Event camera (davis346, evk4), single-photon array (swissspad3, qvga_spad), or path of a .yaml file."
        ),
    ] = "davis346",
    folder: Annotated[
        Path | None, typer.Option("--out", help="Folder to write to (default: DATASET/cameras/SENSOR).")
    ] = None,
    split: Annotated[str | None, typer.Option(help="Record only this split.")] = None,
    sequence: Annotated[list[str] | None, typer.Option(help="Record only this sequence; repeatable.")] = None,
    exposure_us: Annotated[
        float | None,
        typer.Option(
            help="Single photons: time for which the gate is open in each frame (default: until the target detects a "
            "photon in half of the frames, at most a frame)."
        ),
    ] = None,
) -> None:
    """Record the sequences of a dataset with another camera: same scene, lens, light and truth, other sensor."""
    from saf_gen.stack.other_cameras import find_camera
    from saf_gen.stream.manifest import read_manifest
    from saf_gen.stream.stream_file import open_stream

    camera, manifest = find_camera(sensor, exposure_us=exposure_us), read_manifest(dataset)
    if split is not None and split not in manifest.splits:
        raise unknown("split", split, allowed=manifest.splits, where=str(dataset))
    entries = [entry for entry in manifest.sequences if split in (None, entry.split)]
    for name in sequence or ():
        if name not in [entry.id for entry in entries]:
            raise unknown("sequence", name, allowed=[entry.id for entry in entries], where=str(dataset))
    entries = [entry for entry in entries if not sequence or entry.id in sequence]
    target = folder or dataset / "cameras" / camera.name
    if target.resolve() == dataset.resolve():
        raise BadInput(f"--out is the dataset itself, {dataset}", allowed="another folder")
    for entry in entries:
        camera.check_replaceable(target / entry.split / f"{entry.id}.h5")
    made, kept, failed = 0, 0, 0
    with progress_bars() as bars:
        report = terminal_reporter("record", bars)
        for number, entry in enumerate(entries):
            report(number, len(entries), entry.id)
            path = target / entry.split / f"{entry.id}.h5"
            try:
                with open_stream(dataset / entry.file) as stream:
                    if camera.has_recorded(path, stream.content_sha256):
                        kept += 1
                        continue
                    said = camera.record(stream, dataset / "stacks", path=path)
            except BadInput as error:
                print_error(f"{entry.id}: {error}", 1)
                failed += 1
                continue
            made += 1
            out.print(escape_controls(f"{entry.id}: {said}"), soft_wrap=True, markup=False)
    _report(camera, target, made=made, kept=kept)
    if next_command := camera.finish(dataset, manifest, target=target):
        out.print(escape_controls(f"next: {next_command}"), soft_wrap=True, markup=False)
    if failed:
        raise typer.Exit(1)


def _report(camera: "OtherCamera", target: Path, *, made: int, kept: int) -> None:
    kept_words = f", {kept} kept" if kept else ""
    done = f"{plural(made, 'sequence')} recorded with {camera.name}{kept_words}: {target}"
    out.print(escape_controls(done), soft_wrap=True, markup=False)
