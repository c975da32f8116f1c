"""The command ``events``."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._terminal import out, print_error, progress_bars, terminal_reporter
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput, escape_controls, unknown


def events_command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder with its stacks.")],
    *,
    sensor: Annotated[
        str, typer.Option(help="Event camera: davis346, evk4, or the path of a .yaml file.")
    ] = "davis346",
    folder: Annotated[
        Path | None, typer.Option("--out", help="Folder to write to (default: DATASET/events/SENSOR).")
    ] = None,
    split: Annotated[str | None, typer.Option(help="Record only this split.")] = None,
    sequence: Annotated[list[str] | None, typer.Option(help="Record only this sequence; repeatable.")] = None,
) -> None:
    """Record the sequences of a dataset with an event camera: same scene, lens, light and truth, other sensor."""
    from saf_gen.camera.events import get_event_sensor
    from saf_gen.stack.event_capture import events_fingerprint, record_events
    from saf_gen.stream.event_file import check_replaceable, intact_digest
    from saf_gen.stream.manifest import read_manifest
    from saf_gen.stream.stream_file import open_stream

    camera, manifest = get_event_sensor(sensor), read_manifest(dataset)
    if split is not None and split not in manifest.splits:
        raise unknown("split", split, allowed=manifest.splits, where=str(dataset))
    entries = [entry for entry in manifest.sequences if split in (None, entry.split)]
    for name in sequence or ():
        if name not in [entry.id for entry in entries]:
            raise unknown("sequence", name, allowed=[entry.id for entry in entries], where=str(dataset))
    entries = [entry for entry in entries if not sequence or entry.id in sequence]
    target = folder or dataset / "events" / camera.name
    paths = {entry.id: target / entry.split / f"{entry.id}.h5" for entry in entries}
    for path in paths.values():
        check_replaceable(path)
    made, kept, failed = 0, 0, 0
    with progress_bars() as bars:
        report = terminal_reporter("record", bars)
        for number, entry in enumerate(entries):
            report(number, len(entries), entry.id)
            path = paths[entry.id]
            try:
                with open_stream(dataset / entry.file) as stream:
                    if intact_digest(path, events_fingerprint(stream, camera)) is not None:
                        kept += 1
                        continue
                    count, digest = record_events(stream, dataset / "stacks", sensor=camera, path=path)
            except BadInput as error:
                print_error(f"{entry.id}: {error}", 1)
                failed += 1
                continue
            made += 1
            line = f"{entry.id}: {count:,} events, sha256 {digest[:16]}"
            out.print(escape_controls(line), soft_wrap=True, markup=False)
    kept_words = f", {kept} kept" if kept else ""
    done = f"{plural(made, 'sequence')} recorded with {camera.name}{kept_words}: {target}"
    out.print(escape_controls(done), soft_wrap=True, markup=False)
    if failed:
        raise typer.Exit(1)
