"""The commands ``import``, ``export``, ``inspect`` and ``dataset index``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import AsJson, err, out
from saf_gen.errors import BadInput, unknown


def import_(
    file: Annotated[Path, typer.Argument(help="File of raw frames from another camera or project.")],
    target: Annotated[Path, typer.Option("--out", help="Stream file to write.")],
    *,
    layout: Annotated[str, typer.Option(help="Layout of the file: 416, dense, sps1000, or auto.")] = "auto",
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames to import (default: all).")] = None,
    rate: Annotated[float, typer.Option(help="Readouts per second; raw files do not record it.")] = 20_000.0,
    flip: Annotated[bool | None, typer.Option(help="Rows are stored bottom first (default: as in the layout).")] = None,
    focus: Annotated[
        Path | None, typer.Option(help="Lens log: CSV with frame,position or seconds,position (0 to 1 of the travel).")
    ] = None,
    truth: Annotated[
        str | None, typer.Option(help="True focus: a position (0.42), or a frame of the lens log (frame:812).")
    ] = None,
    depth_of_focus: Annotated[
        tuple[float, float] | None, typer.Option(help="Positions, near and far, between which the target is sharp.")
    ] = None,
) -> None:
    """Convert a raw spike file to a stream, with what is known of its lens and focus."""
    from saf_gen.stream import interop
    from saf_gen.stream.stream_file import open_stream

    looks = _looks_like(file)
    kind = (looks or interop.sniff_raw_layout(file)) if layout == "auto" else layout
    known: dict[str, Any] = {}
    count = interop.count_raw_frames(file, kind, frames=frames)
    if focus is not None:
        known["focus_position"] = interop.read_lens_log(focus, frames=count, readout_hz=rate)
    if truth is not None:
        known["truth"] = interop.truth_from_text(
            truth, focus_position=known.get("focus_position"), depth_of_focus=depth_of_focus
        )
    elif depth_of_focus is not None:
        raise BadInput("--depth-of-focus is given without --truth", hint="add the position of best focus")
    if looks not in (None, kind):
        err.print(f"{file} looks like layout {looks}, and is read as {kind}")
    digest = interop.import_raw_frames(file, target, layout=kind, frames=frames, readout_hz=rate, flip=flip, **known)
    with open_stream(target) as stream:
        count, rows, columns = stream.shape
    out.print(f"{count} frames of {columns}×{rows} in {target}, read as layout {kind}, sha256 {digest[:16]}")


def _looks_like(file: Path) -> str | None:
    """Return the layout that a file seems to have; None where it cannot be told, or the import says what is wrong."""
    from saf_gen.stream.interop import sniff_raw_layout

    try:
        return sniff_raw_layout(file)
    except BadInput:
        return None


def export(
    stream: Annotated[Path, typer.Argument(help="Stream file.")],
    target: Annotated[Path, typer.Option("--out", help="Raw file to write.")],
    *,
    layout: Annotated[
        str | None, typer.Option(help="Layout of the file: 416, dense or sps1000 (default: as the array has it).")
    ] = None,
    reader: Annotated[
        str | None, typer.Option("--for", help="Software that is to read it: spikecv, spike-zoo, saf or rsir.")
    ] = None,
    flip: Annotated[bool | None, typer.Option(help="Store the bottom row first (default: as in the layout).")] = None,
) -> None:
    """Convert a stream to a raw spike file."""
    from saf_gen.stream.interop import READERS, export_raw_frames
    from saf_gen.stream.stream_file import open_stream

    if reader is not None and layout is not None:
        raise BadInput("--layout and --for are both given", hint="keep one: a reader has its layout")
    if reader is not None and reader not in READERS:
        raise unknown("reader", reader, allowed=READERS)
    if layout is None:
        with open_stream(stream) as opened:
            layout = READERS[reader] if reader else "sps1000" if opened.shape[1:] == (1000, 1000) else "dense"
    out.print(f"{export_raw_frames(stream, target, layout=layout, flip=flip)} bytes in {target}, layout {layout}")


def index(
    folder: Annotated[Path, typer.Argument(help="Folder of streams (.h5), in it or in folders of splits.")],
    *,
    split: Annotated[str, typer.Option(help="Split of the streams that lie in the folder itself.")] = "test",
) -> None:
    """Make a folder of streams a dataset, which evaluate takes: write its manifest."""
    from saf_gen.stream.dataset_index import index_folder

    manifest = index_folder(folder, split=split)
    out.print(f"{len(manifest.sequences)} sequences in splits {', '.join(manifest.splits)}: saf-gen evaluate {folder}")


def inspect(stream: Annotated[Path, typer.Argument(help="Stream file.")], *, as_json: AsJson = False) -> None:
    """Describe a stream: what is in it (length, rates, light, lens, true focus), and how it was made."""
    from saf_gen.stream.description import describe_content, describe_making
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        content, making = describe_content(opened), describe_making(opened)
    columns = TableColumn(""), TableColumn("", folds=True)
    if as_json:
        print_table(columns, [*content.items(), *making.items()], as_json=True)
        return
    print_table(columns, content.items(), title=str(stream))
    print_table(columns, making.items(), title="how it was made")
