"""Pictures of a recording, for people to look at: a figure, a moving picture, or a page to scrub through."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from saf_gen.core.files import file_name_as_text, write_atomically
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.measure_input import choose_stream_region
from saf_gen.stream.pictures.windows import KINDS, WindowPictures, choose_windows_of_stream
from saf_gen.stream.readable import ReadableStream

__all__ = ["FORMS", "KINDS", "ViewForm", "write_view"]


@dataclass(frozen=True)
class ViewForm:
    """A kind of file: what it is, how many pictures it has unless told, and the most it may have."""

    words: str
    count: int
    most: int


FORMS = {
    "png": ViewForm("figure", 6, 48),
    "pdf": ViewForm("figure", 6, 48),
    "svg": ViewForm("figure", 6, 48),
    "gif": ViewForm("moving picture", 60, 300),
    "mp4": ViewForm("video", 200, 100_000),
    "html": ViewForm("page", 60, 400),
}


def write_view(
    stream: ReadableStream,
    path: str | Path,
    *,
    kind: str = "tfp",
    window: int | None = None,
    first: int = 0,
    stop: int | None = None,
    every: int | None = None,
    measures: Sequence[str] = (),
    region: str = "target",
    fps: float = 12.0,
) -> WindowPictures:
    """Write pictures of a recording with its lens, light, truth and scores, and return which.

    Parameters
    ----------
    stream : the open recording; a window is read at a time, so memory does not grow with its length.
    path : the file to write; its ending is a key of FORMS.
    kind : a key of KINDS.
    window : frames in a window, which measures score too; 100 unless told, or a tenth of a short view.
    first, stop : the view, frames ``first <= t < stop``; the whole recording unless told.
    every : frames from one picture to the next; unless told, so many that there are ``FORMS[...].count`` pictures.
    measures : names of focus measures whose curves are drawn.
    region : where measures look, drawn as a box: ``target`` where the stream has one, or ``frame``.
    fps : pictures per second of what moves, above 0 and at most 100.

    Raises
    ------
    BadInput : another ending, an unknown kind, measure or region, frames that are not there, more pictures than the
        file may have, and a file that cannot be written. Nothing is written then.
    """
    target = Path(path)
    form = target.suffix.removeprefix(".").lower()
    if form not in FORMS:
        endings = [f".{name}" for name in FORMS]
        raise unknown("kind of file", target.suffix or target.name, allowed=endings, where=str(path))
    if region not in REGIONS:
        raise unknown("region", region, allowed=REGIONS)
    if not 0 < fps <= 100:
        raise BadInput(f"{fps:g} pictures per second", allowed="above 0, at most 100")
    of = FORMS[form]
    pictures = choose_windows_of_stream(
        stream, kind=kind, window=window, first=first, stop=stop, every=every, count=of.count, most=of.most
    )
    # Imported late: matplotlib takes a second, and an error should not wait for it.
    from saf_gen.stream.pictures import movie, player, still
    from saf_gen.stream.pictures.timeline import read_stream_timeline

    box, _ = choose_stream_region(stream, region)
    timeline = read_stream_timeline(
        stream,
        first=first,
        stop=stream.shape[0] if stop is None else stop,
        window=pictures.window,
        measures=measures,
        region=box,
    )
    with write_atomically(target) as part:
        if form == "html":
            player.write_stream_player(
                pictures, timeline, region=box, path=part, title=file_name_as_text(stream.path.stem), fps=fps
            )
        elif form in ("gif", "mp4"):
            screen = movie.Screen(pictures, timeline, region=box)
            if form == "gif":
                movie.write_gif_of_stream(screen, part, fps=fps)
            else:
                movie.write_mp4_of_stream(screen, part, size=screen.size, fps=fps)
        else:
            still.draw_still_of_stream(pictures, timeline, region=box, path=part, form=form)
    return pictures
