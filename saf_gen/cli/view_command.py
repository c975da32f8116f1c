"""The command ``view``."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._terminal import out


def view_command(
    stream: Annotated[Path, typer.Argument(help="Stream file.")],
    target: Annotated[Path, typer.Option("--out", help="File to write: .png, .pdf, .svg, .gif, .mp4 or .html.")],
    *,
    kind: Annotated[
        str, typer.Option("--as", help="tfp (counts of a window), tfi (from intervals), or spikes (one readout).")
    ] = "tfp",
    window: Annotated[
        int | None, typer.Option(min=1, help="Frames per window (default: 100, or a tenth of a short view).")
    ] = None,
    first: Annotated[int, typer.Option("--from", min=0, help="First frame of the view.")] = 0,
    stop: Annotated[int | None, typer.Option("--to", min=1, help="Frame after the last one (default: all).")] = None,
    every: Annotated[
        int | None, typer.Option(min=1, help="Frames from one picture to the next (default: evenly spaced).")
    ] = None,
    measure: Annotated[list[str] | None, typer.Option(help="Focus measure whose curve is drawn; repeatable.")] = None,
    region: Annotated[str, typer.Option(help="Where measures look: target (its box is drawn) or frame.")] = "target",
    fps: Annotated[float, typer.Option(help="Pictures per second of .gif, .mp4 and .html.")] = 12.0,
) -> None:
    """Draw pictures of a stream, together with its lens position, light, truth and scores."""
    from saf_gen.stream.pictures import write_view
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        pictures = write_view(
            opened,
            target,
            kind=kind,
            window=window,
            first=first,
            stop=stop,
            every=every,
            measures=measure or (),
            region=region,
            fps=fps,
        )
    out.print(f"{len(pictures.starts)} pictures of {pictures.window} frames each in {target}")
