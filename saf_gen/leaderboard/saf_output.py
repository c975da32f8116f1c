"""Output of a ranking on SAF's recordings: its files, and its table for the terminal."""

import json
from dataclasses import asdict, fields
from pathlib import Path

from saf_gen import __version__
from saf_gen.core.files import write_text
from saf_gen.core.plain_text import escape_markdown
from saf_gen.leaderboard.columns import format_leaderboard_percent
from saf_gen.leaderboard.csv_output import format_leaderboard_csv
from saf_gen.leaderboard.rank_agreement import AGREEMENT_MEANINGS
from saf_gen.leaderboard.saf_protocol import SafRanking
from saf_gen.leaderboard.saf_ranking import SafAnswer, SafRow
from saf_gen.leaderboard.table_formats import (
    format_leaderboard_count,
    format_rank_agreement_markdown,
    format_ranking_grid,
)

PROTOCOL_NOTES = (
    "SAF's protocol: blocks of dt frames, with dt from config.xlsx; the answer is the last frame of the best block,"
    " counted from 1; the truth is a frame chosen by hand. The authors state neither a limit within which an answer is"
    " right nor a table of errors; they plot the printed frame together with the chosen frame. CEN (ICML 2026) reports"
    " mean errors in blocks. Methods are ranked by the mean error over scenes, as a fraction of the recording;"
    " a missing answer counts as the largest possible error.",
    "Our protocol: the same recordings; each search uses its own windows and answers with the centre of a window. In"
    " both protocols, measures look at the whole frame, because these recordings name no target.",
    "Unknown for these recordings: lens, aperture, pixels, the position of the lens in each frame (it is assumed to"
    " move evenly), the error of the chosen frame, and the light schedule. Therefore the depth of focus and success"
    " within it are unknown.",
)


def list_saf_ranking_headers(ranking: SafRanking) -> list[str]:
    """Return the column headings of a ranking's table; the last are of the evaluations of other data, if any."""
    return [
        *("rank", "method", "error, % of recording", "median, frames", "mean, blocks", "within a block", "no answer"),
        *("rank, ours", "error, % ", "median, frames "),
        *(f"within 1 DoF, {run}" for run in ranking.beside),
    ]


def format_saf_ranking_row(row: SafRow) -> list[str]:
    """Return the texts of one row of the table."""

    def text(value: float | None) -> str:
        return "–" if value is None else f"{value:.1f}"

    return [
        *(str(row.rank), row.method, f"{100 * row.off:.2f}", text(row.error_frames)),
        text(row.error_blocks),
        *(format_leaderboard_percent(row.within_block), str(row.unanswered)),
        *(str(row.own_rank), f"{100 * row.own_off:.2f}", text(row.own_error_frames)),
        *("–" if success is None else format_leaderboard_percent(success) for success in row.beside),
    ]


def describe_saf_ranking(ranking: SafRanking) -> str:
    """Return the numbers of methods, recordings and scenes of a ranking, as text."""
    recordings, scenes = len({a.recording for a in ranking.answers}), len({a.scene for a in ranking.answers})
    return (
        f"{format_leaderboard_count(len(ranking.rows), 'method')} on "
        f"{format_leaderboard_count(recordings, 'recording')} of {format_leaderboard_count(scenes, 'scene')}"
    )


def write_saf_ranking(folder: Path, ranking: SafRanking) -> list[Path]:
    """Write ``ranking.json``, ``ranking.md`` and ``answers.csv``; return their paths."""
    names = [field.name for field in fields(SafAnswer)]
    document = {
        "format": "saf-gen ranking on SAF's recordings 1",
        "version": __version__,
        "protocol": list(PROTOCOL_NOTES),
        "beside": list(ranking.beside),
        "rows": [asdict(row) for row in ranking.rows],
        "rank_agreement": [asdict(one) for one in ranking.agreement],
        "meanings": AGREEMENT_MEANINGS,
        "left_out": dict(ranking.left_out),
    }
    texts = {
        "ranking.json": json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        "ranking.md": _format_markdown(ranking),
        "answers.csv": format_leaderboard_csv(
            [*names, "error", "own_error"],
            ([*(getattr(one, name) for name in names), one.error, one.own_error] for one in ranking.answers),
        ),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def _format_markdown(ranking: SafRanking) -> str:
    headers = list_saf_ranking_headers(ranking)
    rows = [format_saf_ranking_row(row) for row in ranking.rows]
    grid = format_ranking_grid(
        list(map(escape_markdown, headers)),
        [[escape_markdown(text) for text in row] for row in rows],
        is_left=[n == 1 for n in range(len(headers))],
    )
    parts = [f"# {describe_saf_ranking(ranking)}\n", grid, *(f"{note}\n" for note in PROTOCOL_NOTES)]
    if ranking.agreement:
        parts += ["## Agreement of ranks\n", format_rank_agreement_markdown(ranking.agreement)]
    if ranking.left_out:
        lines = (f"- {escape_markdown(name)}: {escape_markdown(why)}\n" for name, why in ranking.left_out.items())
        parts += ["## Not run\n", "".join(lines)]
    return "\n".join(parts)
