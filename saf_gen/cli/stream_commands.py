"""The commands ``import``, ``export`` and ``inspect``."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import out


def import_(
    file: Annotated[Path, typer.Argument(help="File of raw frames from another camera or project.")],
    target: Annotated[Path, typer.Option("--out", help="Stream file to write.")],
    *,
    layout: Annotated[str, typer.Option(help="Layout of the file: 416, dense or sps1000.")] = "416",
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames to import (default: all).")] = None,
    rate: Annotated[float, typer.Option(help="Readouts per second; raw files do not record it.")] = 20_000.0,
    flip: Annotated[bool | None, typer.Option(help="Rows are stored bottom first (default: as in the layout).")] = None,
) -> None:
    """Convert a raw spike file to a stream."""
    from saf_gen.stream.interop import import_raw_frames
    from saf_gen.stream.stream_file import open_stream

    digest = import_raw_frames(file, target, layout=layout, frames=frames, readout_hz=rate, flip=flip)
    with open_stream(target) as stream:
        count, rows, columns = stream.shape
    out.print(f"{count} frames of {columns}×{rows} in {target}, sha256 {digest[:16]}…")


def export(
    stream: Annotated[Path, typer.Argument(help="Stream file.")],
    target: Annotated[Path, typer.Option("--out", help="Raw file to write.")],
    *,
    layout: Annotated[str, typer.Option(help="Layout of the file: 416, dense or sps1000.")] = "416",
) -> None:
    """Convert a stream to a raw spike file."""
    from saf_gen.stream.interop import export_raw_frames

    out.print(f"{export_raw_frames(stream, target, layout=layout)} bytes in {target}")


def inspect(stream: Annotated[Path, typer.Argument(help="Stream file.")]) -> None:
    """Describe a stream: size, light, true focus, and how it was made."""
    from saf_gen.stream.inspection import describe_stream_file
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        facts = describe_stream_file(opened)
    print_table([TableColumn(""), TableColumn("", folds=True)], facts.items(), title=str(stream))
