"""Every leaderboard says once what its short names stand for, in the words of the plug-ins themselves."""

import pytest
from handmade_evaluations import make_evaluation, write_board
from handmade_records import record

from saf_gen.core.config.registry import names
from saf_gen.leaderboard import Leaderboard
from saf_gen.leaderboard.report.page import build_page
from saf_gen.leaderboard.results import spell_out_names

RECORDS = [record(method, "a", 0.3) for method in ("sd+argmax", "sd+argmax:window=50", "vollath_f4_n+argmax_light")]


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("sd+argmax:window=50@frame", {"sd": "spike dispersion", "argmax": "exhaustive search"}),
        (
            "tenengrad_n_tfi+golden_section",
            {
                "tenengrad_n_tfi": "energy of the Sobel gradient, divided by brightness, on intervals between spikes",
                "golden_section": "golden section search",
            },
        ),
        ("squared_gradient+fibonacci", {"fibonacci": "Fibonacci search"}),
        ("mine.py:Mine+argmax", {"argmax": "exhaustive search"}),
        ("their_network", {}),
        ("their network@nowhere", {}),
        ("a+b+c", {}),
    ],
)
def test_names_of_saf_gen_are_spelled_out_and_others_are_left_out(method, words):
    assert spell_out_names([method]) == words


def test_every_plugin_has_short_words_that_are_its_own():
    """The first line of the module begins with a few words before a colon, a comma or its end."""
    every = [f"{measure}+argmax" for measure in names("measures")] + [f"sd+{search}" for search in names("searches")]
    words = spell_out_names(every)
    assert len(set(words.values())) == len(words)
    known = {*names("measures"), *names("searches")}
    assert known - set(words) == {"squared_gradient"}
    assert all(len(spelled) <= 55 and spelled[-1] not in ".:," for spelled in words.values())


def test_leaderboard_md_spells_out_each_name_once(tmp_path):
    write_board(tmp_path, RECORDS)
    text = (tmp_path / "leaderboard.md").read_text(encoding="utf-8")
    assert (
        text.count("Names: sd: spike dispersion; vollath_f4_n: ")
        == text.count("Vollath's F4, divided by brightness")
        == 1
    )
    assert "spike dispersion" not in (tmp_path / "leaderboard.csv").read_text(encoding="utf-8")


def test_the_page_lists_the_names_beneath_the_table():
    page = build_page(Leaderboard.of(make_evaluation()), title="t")
    folded = page.partition('<details id="names">')[2].partition("</details>")[0]
    assert "<dt><code>sd</code></dt><dd>spike dispersion</dd>" in folded
    assert page.index('id="board"') < page.index('id="names"') < page.index('id="methods"')
