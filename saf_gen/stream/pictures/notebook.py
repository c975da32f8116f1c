"""HTML by which a notebook shows a stream: some of its pictures and a table of facts."""

from base64 import b64encode
from html import escape

from saf_gen.stream.description import describe_content
from saf_gen.stream.pictures.image_strip import encode_jpegs, lay_out_pictures
from saf_gen.stream.pictures.window_pictures import choose_windows
from saf_gen.stream.readable import ReadableStream

PICTURES, MAX_BYTES = 5, 300_000


def stream_html(stream: ReadableStream) -> str:
    """Return evenly spaced pictures of a stream and a table of facts as HTML without scripts.

    Only five windows are read, so that a long recording takes no more time than a short one.
    """
    pictures = choose_windows(stream, count=PICTURES)
    strip = encode_jpegs(lay_out_pictures(pictures, count=len(pictures.starts)), max_bytes=MAX_BYTES)
    source = f"data:{strip.media_type};base64,{b64encode(strip.file).decode()}"
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in describe_content(stream, with_rates=False).items()
    )
    centres = ", ".join(f"{centre:,.0f}" for centre in pictures.centres)
    words = f"{pictures.window} frames each, around the frames {centres}"
    return (
        f"<div><b>{escape(stream.path.name)}</b><br>"
        f'<img style="max-width:100%" src="{source}" alt="{strip.count} pictures: {words}"><br>'
        f"<small>{words}</small><table>{rows}</table></div>"
    )
