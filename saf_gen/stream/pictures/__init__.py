"""Pictures of a recording as a figure, a moving picture, or a page to scrub through."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from saf_gen.core.files import atomic_file, name_as_text
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.metadata import ReadableStream
from saf_gen.stream.pictures.timeline import KINDS, WindowPictures, choose_windows

__all__ = ["FORMS", "KINDS", "ViewForm", "write_view"]


@dataclass(frozen=True)
class ViewForm:
    """A kind of file: its name in words, and its default and largest number of pictures."""

    words: str
    count: int
    max_count: int


FORMS = {
    "png": ViewForm("figure", 6, 48),
    "svg": ViewForm("figure", 6, 48),
    "gif": ViewForm("moving picture", 60, 300),
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
    at: Sequence[float] = (),
    measures: Sequence[str] = (),
    find_measure: Callable[[str], Callable[..., float]] = get_measure,
    region: str = "target",
    fps: float = 12.0,
) -> WindowPictures:
    """Write pictures of a recording with plots of its lens, light, truth and scores.

    Parameters
    ----------
    stream : ReadableStream
        The open recording. It is read one window at a time, so that memory does not grow with its length.
    path : str or Path
        File to write; its ending is a key of FORMS.
    kind : str, default "tfp"
        A key of KINDS.
    window : int, optional
        Frames per window, both of pictures and of scores; by default 100, or a tenth of the view if it has fewer than
        1,000 frames, or one of a frame camera.
    first, stop : int, optional
        The view, frames ``first <= t < stop``; by default the whole recording.
    every : int, optional
        Frames from one picture to the next; by default chosen to give ``FORMS[...].count`` pictures.
    at : sequence of float, default ()
        Frames at the middle of the only pictures; by default pictures are spread over the view.
    measures : sequence of str, default ()
        Names of focus measures whose curves are drawn.
    find_measure : callable, optional
        Called with each name; returns the measure.
    region : str, default "target"
        Region that measures score, drawn as a box: ``target``, or ``frame`` for the whole frame, which is also used if
        the stream has no target.
    fps : float, default 12
        Pictures per second of a moving picture, above 0 and at most 100.

    Returns
    -------
    WindowPictures
        The pictures that were written.

    Raises
    ------
    BadInput
        If the ending, kind, measure or region is unknown, the view leaves the recording, there are too many pictures
        for this kind of file, or the file cannot be written. Nothing is written then.
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
    pictures = choose_windows(
        stream,
        kind=kind,
        window=window,
        first=first,
        stop=stop,
        every=every,
        at=at,
        count=of.count,
        max_count=of.max_count,
    )
    # Imported late, because matplotlib takes a second and an error should not wait for it.
    from saf_gen.stream.pictures import movie, panels, player
    from saf_gen.stream.pictures.timeline import read_timeline

    box, _ = choose_region(stream, region)
    timeline = read_timeline(
        stream,
        first=first,
        stop=stream.shape[0] if stop is None else stop,
        window=pictures.window,
        measures=measures,
        find_measure=find_measure,
        region=box,
    )
    with atomic_file(target) as part:
        if form == "html":
            player.write_player(
                pictures, timeline, region=box, path=part, title=name_as_text(stream.path.stem), fps=fps
            )
        elif form == "gif":
            movie.write_gif(movie.MovieCanvas(pictures, timeline, region=box), part, fps=fps)
        else:
            panels.draw_still(pictures, timeline, region=box, path=part, form=form)
    return pictures
