"""One page of an evaluation: the table, the figures, what the columns mean, the digests of the data.

The page is a single file: styles inline, pictures embedded, no script; it reads on a phone and in the dark.
"""

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from string import Template

from saf_gen import __version__
from saf_gen.dataset import write_text
from saf_gen.evaluate import Evaluation, Failure, Sweep
from saf_gen.figures import curves_figure, errors_figure, to_png
from saf_gen.files import replaced
from saf_gen.leaderboard import Column, Row, columns
from saf_gen.scores import Record

__all__ = ["Picture", "page", "scenes", "write_report"]

_PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>$title</title>
<style>
:root { --ink: #1f2328; --soft: #5b6470; --line: #d8dce1; --paper: #fff; --bar: #cfe3f3; --best: #0072b2;
  --warn: #fbe9e0; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8eb; --soft: #9aa4b0; --line: #363c44;
  --paper: #14171b; --bar: #1d3f58; --best: #7cc4f0; --warn: #4a2a1a; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 84rem; padding: 1.5rem 1rem 4rem; background: var(--paper);
  color: var(--ink); font: 1rem/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 0 0 .25rem; }
h2 { font-size: 1.2rem; margin: 2.5rem 0 .5rem; }
p { margin: .4rem 0; max-width: 46rem; }
.soft, figcaption { color: var(--soft); font-size: .9rem; }
.wide { overflow-x: auto; margin: 0 -1rem; padding: 0 1rem; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums;
  white-space: nowrap; }
th, td { padding: .3rem .5rem; border-bottom: 1px solid var(--line); text-align: right; }
th { vertical-align: bottom; color: var(--soft); font-weight: 600; }
th.left, td.left { text-align: left; }
th.group { text-align: center; border-bottom: 0; padding-bottom: 0; font-weight: 400; }
td.method { font-family: ui-monospace, monospace; font-size: .82rem; }
td.share { background: linear-gradient(to right, var(--bar) var(--v), transparent var(--v)) no-repeat
  .2rem 50% / calc(100% - .4rem) 74%; }
td.ranks { font-weight: 700; }
tr.first td.method { color: var(--best); font-weight: 700; }
figure { margin: 1.2rem 0 2rem; }
figcaption { margin-top: .5rem; max-width: 60rem; }
figure img { display: block; width: 100%; min-width: 46rem; height: auto; background: #fff;
  border-radius: .4rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1rem; max-width: 52rem;
  font-size: .92rem; }
dt { font-weight: 600; } dd { margin: 0; color: var(--soft); }
.failures { background: var(--warn); padding: .6rem 1rem; border-radius: .4rem; }
details { margin-top: 1rem; } summary { cursor: pointer; }
code { font-family: ui-monospace, monospace; font-size: .85em; overflow-wrap: anywhere; }
@media (max-width: 40rem) { dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: .5rem; } }
</style>
</head>
<body>
<h1>$title</h1>
<p class="soft">$summary</p>
<p>$lead</p>
$failures
<h2>Leaderboard</h2>
<div class="wide"><table>
<thead>$heads</thead>
<tbody>
$rows
</tbody></table></div>
$figures
<h2>What the columns mean</h2>
<dl>$meanings</dl>
<p class="soft">DoF is the depth of focus: the way of the lens over which the target's blur stays below one
pixel. Success averages a scene's light schedules first, then the scenes. Error is answer minus truth, and the
truth is the optical focus of the target, never a frame chosen by hand. Abstentions and failures are no
errors; they count as no success, save an abstention where the focus lies outside the travel.</p>
<h2>Data</h2>
<details><summary>Digests of $count sequences and $methods methods</summary>
<div class="wide"><table>
<thead><tr><th class="left">sequence</th><th class="left">content_sha256</th></tr></thead>
<tbody>
$digests
</tbody></table></div>
<div class="wide"><table>
<thead><tr><th class="left">method</th><th class="left">code</th></tr></thead>
<tbody>
$codes
</tbody></table></div></details>
<p class="soft">Made by saf_gen $version. The same numbers: leaderboard.json, leaderboard.csv,
leaderboard.md; each answer: records.jsonl.</p>
</body>
</html>
""")
_FIGURE = Template("""<figure><div class="wide"><img alt="$alt" src="data:image/png;base64,$data"></div>
<figcaption>$caption</figcaption></figure>""")
_CURVES = (
    "Every measure by its own minimum and maximum, over the lens position; over frames where the lens comes "
    "back or rests. Grey: the light, as mean counts. "
    "Yellow: the depth of focus round the true focus. Marks on top: where each measure is largest. "
    "A measure that follows the grey area follows the light, not the focus."
)
_ERRORS = "Each method's answer against the truth, a mark for each sequence. The closer to 0, the sharper."


@dataclass(frozen=True)
class Picture:
    """A figure on the page: its file beside the page, the scene it is of, what it shows, the PNG."""

    file: str
    heading: str
    caption: str
    png: bytes


def scenes(sweeps: Sequence[Sweep]) -> dict[tuple[str | None, str], list[Sweep]]:
    """What to draw: for each (split, scene) the first sequence under each light schedule that has curves."""
    found: dict[tuple[str | None, str], dict[str | None, Sweep]] = {}
    for sweep in sweeps:
        if sweep.curves:
            found.setdefault((sweep.split, sweep.scene), {}).setdefault(sweep.light, sweep)
    return {key: list(lights.values()) for key, lights in found.items()}


def write_report(
    folder: str | Path, *, evaluation: Evaluation, rows: Sequence[Row], title: str
) -> list[Path]:
    """Draw the figures of every scene and write them with index.html into ``folder``; returns the paths.

    ``curves/<split>-<scene>.png`` holds the focus curves, for measures that argmax searched,
    ``errors/<split>-<scene>.png`` the errors, where the truth is known.
    """
    out = Path(folder)
    pictures: list[Picture] = []
    for (split, scene), sweeps in scenes(evaluation.sweeps).items():
        name = _heading(split, scene)
        png = to_png(curves_figure(sweeps, title=f"{name}: focus curves"))
        pictures.append(Picture(f"curves/{_file(split, scene)}", name, _CURVES, png))
    order = {row.method: number for number, row in enumerate(rows)}
    by_scene: dict[tuple[str | None, str], list[Record]] = {}
    for record in sorted(evaluation.records, key=lambda r: order.get(r.method, len(order))):
        by_scene.setdefault((record.split, record.scene), []).append(record)
    for (split, scene), records in by_scene.items():
        if any(r.error_dof is not None for r in records):
            name = _heading(split, scene)
            png = to_png(errors_figure(records, title=f"{name}: errors"))
            pictures.append(Picture(f"errors/{_file(split, scene)}", name, _ERRORS, png))
    for picture in pictures:
        with replaced(out / picture.file) as part:
            part.write_bytes(picture.png)
    text = page(
        rows, title=title, records=evaluation.records, failures=evaluation.failures, pictures=pictures
    )
    write_text(out / "index.html", text)
    return [out / "index.html", *(out / picture.file for picture in pictures)]


def page(
    rows: Sequence[Row],
    *,
    title: str,
    records: Sequence[Record],
    failures: Sequence[Failure] = (),
    pictures: Sequence[Picture] = (),
) -> str:
    """The page as HTML. ``pictures`` are shown scene by scene."""
    shown = columns(rows)
    data = {r.sequence: r.data for r in records}
    code = {r.method: r.code for r in records}
    places = len({r.scene for r in records})
    return _PAGE.substitute(
        title=_text(title),
        summary=_text(
            f"{len(rows)} methods on {len(data)} sequences of {places} {'scene' if places == 1 else 'scenes'}"
        ),
        lead=_lead(rows),
        failures=_failures(failures),
        heads=_heads(shown),
        rows="\n".join(_row(row, shown) for row in rows),
        figures=_figures(pictures),
        meanings="".join(f"<dt>{_text(c.header)}</dt><dd>{_text(c.meaning)}</dd>" for c in shown),
        count=len(data),
        methods=len(code),
        digests=_pairs(data),
        codes=_pairs(code),
        version=_text(__version__),
    )


def _lead(rows: Sequence[Row]) -> str:
    first = [row for row in rows if row.rank == 1]
    if not first:
        return "No sequence has a known truth, so nothing is ranked: the table shows cost only."
    names = ", ".join(f"<code>{_text(row.method)}</code>" for row in first[:4])
    if len(first) > 4:
        names += f" and {len(first) - 4} more"
    share = f"{first[0].success_1dof:.0%}"
    verb = "lead together" if len(first) > 1 else "leads"
    return f"{names} {verb}: within one depth of focus on {share} of the scenes and lights."


def _failures(failures: Sequence[Failure]) -> str:
    if not failures:
        return ""
    lines = "".join(f"<li><code>{_text(f.sequence)}</code>: {_text(f.problem)}</li>" for f in failures)
    return f'<div class="failures"><strong>Not read, and not in the table:</strong><ul>{lines}</ul></div>'


def _row(row: Row, shown: Sequence[Column]) -> str:
    cells = []
    for column in shown:
        value = column.value(row)
        kinds, style = [str(column.justify)], ""
        if column.name == "method":
            kinds.append("method")
        if column.name.startswith("success") and value is not None:
            kinds.append("share")
            style = f' style="--v:{100 * value:.0f}%"'
        if column.name == "success_1dof":
            kinds.append("ranks")
        cells.append(f'<td class="{" ".join(kinds)}"{style}>{_text(column.text(row))}</td>')
    kind = "first" if row.rank == 1 else "other"
    return f'<tr class="{kind}">{"".join(cells)}</tr>'


def _heads(shown: Sequence[Column]) -> str:
    """Two lines: groups over their columns."""
    groups = "".join(
        f'<th class="group" colspan="{len(list(some))}">{_text(group)}</th>'
        for group, some in groupby(shown, key=lambda c: c.group)
    )
    names = "".join(
        f'<th class="{c.justify}" title="{_text(c.meaning)}">{_text(c.header)}</th>' for c in shown
    )
    return f"<tr>{groups}</tr>\n<tr>{names}</tr>"


def _figures(pictures: Sequence[Picture]) -> str:
    """Scene by scene: a heading, then its curves and its errors."""
    parts: list[str] = []
    for heading in dict.fromkeys(p.heading for p in pictures):
        parts.append(f"<h2>{_text(heading)}</h2>")
        for picture in (p for p in pictures if p.heading == heading):
            alt = f"{Path(picture.file).parent.name} of {heading}"
            encoded = base64.b64encode(picture.png).decode()
            parts.append(_FIGURE.substitute(alt=_text(alt), data=encoded, caption=_text(picture.caption)))
    return "\n".join(parts)


def _pairs(digests: Mapping[str, str]) -> str:
    return "\n".join(
        f'<tr><td class="left">{_text(name)}</td><td class="left"><code>{_text(digest)}</code></td></tr>'
        for name, digest in digests.items()
    )


def _heading(split: str | None, scene: str) -> str:
    return f"{scene} ({split})" if split else scene


def _file(split: str | None, scene: str) -> str:
    return f"{split}-{scene}.png" if split else f"{scene}.png"


def _text(text: str) -> str:
    return html.escape(text, quote=True)
