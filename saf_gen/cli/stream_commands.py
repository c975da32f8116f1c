"""Commands on one stream: ``import``, ``export``, ``inspect``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from saf_gen.cli._terminal import out

__all__ = ["export", "import_", "inspect"]


def import_(
    file: Annotated[Path, typer.Argument(help="A file of another camera or project.")],
    target: Annotated[Path, typer.Option("--out", help="The stream to write.")],
    layout: Annotated[str, typer.Option(help="416, dense or sps1000.")] = "416",
    frames: Annotated[int | None, typer.Option(min=1, help="Only so many frames.")] = None,
    rate: Annotated[float, typer.Option(help="Readouts a second; no such file records it.")] = 20_000.0,
    flip: Annotated[bool | None, typer.Option(help="Bottom row first (default: as the layout is).")] = None,
) -> None:
    """Turn somebody else's spike file into a stream."""
    from saf_gen.stream.interop import import_raw_frames
    from saf_gen.stream.stream_file import open_stream

    digest = import_raw_frames(file, target, layout=layout, frames=frames, readout_hz=rate, flip=flip)
    with open_stream(target) as stream:
        count, rows, columns = stream.shape
    out.print(f"{count} frames of {columns}×{rows} in {target}, sha256 {digest[:16]}…")


def export(
    stream: Annotated[Path, typer.Argument(help="A stream file.")],
    target: Annotated[Path, typer.Option("--out", help="The file to write.")],
    layout: Annotated[str, typer.Option(help="416, dense or sps1000.")] = "416",
) -> None:
    """Write a stream in somebody else's layout."""
    from saf_gen.stream.interop import export_raw_frames

    out.print(f"{export_raw_frames(stream, target, layout=layout)} bytes in {target}")


def inspect(stream: Annotated[Path, typer.Argument(help="A stream file.")]) -> None:
    """Say what is in a stream: size, light, truth, how it was made."""
    from saf_gen.stream.inspection import describe_stream
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        facts = describe_stream(opened)
    table = Table(show_header=False, title=str(stream))
    for name, value in facts.items():
        table.add_row(name, value)
    out.print(table)
