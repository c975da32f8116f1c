"""Abandoned words do not occur in the package."""

import re

import pytest
from small_dataset import HERE

PACKAGE = HERE.parent / "saf_gen"
GIVEN_UP = {
    "reel": "time-resolved focal stack",
    "footage": "plane source",
    "slab": "time block",
    "film": "sensor grid, or captured frames",
    "exposed": "charge source",
    "twin": "brightness-normalised measure, or slow reference",
    "contest": "benchmark",
    "referee": "evaluator",
    "rig": "view, or evaluator",
    "bill": "cost",
    "house": "package",
    "ground floor": "core",
    "told(?! apart)": "reported, named or given",
    "stranger": "untrusted",
    "whoever": "the one who",
    "thereof": "of it",
    "anew": "again",
    "goes as": "is proportional to",
    "room of": "folder",
    "share of": "fraction",
    "(counts|frames|readouts|samples|spikes) an? (pixel|readout|second|window)": "per",
}
"""Words and phrases, and what to write instead."""
KEPT = {
    "film": ("render/", "scene/xml/"),  # Mitsuba's word for the pixels of a camera
    "rig": ("benchmark/", "leaderboard/"),  # a key of records
    "anew": ("scene/library/",),  # frozen files
}
"""Folders in which a word is allowed, and why."""


@pytest.fixture(scope="module")
def words_by_file():
    """The words of each module in lower case; names are split at underscores and capitals."""
    texts = {p.relative_to(PACKAGE).as_posix(): p.read_text() for p in PACKAGE.rglob("*.py")}
    apart = {path: re.sub("(?<=[a-z])(?=[A-Z])", " ", text) for path, text in texts.items()}
    return {path: " ".join(re.findall("[a-z]+|[.:;]", text.lower())) for path, text in apart.items()}


@pytest.mark.parametrize("phrase", GIVEN_UP)
def test_a_word_that_was_given_up_is_not_in_the_package(phrase, words_by_file):
    found = {path for path, words in words_by_file.items() if re.search(rf"\b{phrase}s?\b", words)}
    found = {path for path in found if not path.startswith(KEPT.get(phrase, ("nowhere/",)))}
    assert not found, f"write {GIVEN_UP[phrase]}"
