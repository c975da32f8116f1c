"""What every focus measure, search and lens motion must keep, run over whatever is registered.

The checks are functions, so that the parts broken on purpose at the end can show that each one bites.
"""

import importlib
import inspect
import math
import random
import re
import sys
import tomllib
from dataclasses import dataclass, is_dataclass
from functools import partialmethod
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from saf_gen import get_measure, get_motion, get_search, registry
from saf_gen.errors import BadInput
from saf_gen.measures import measure_names
from saf_gen.motions import readout_positions
from saf_gen.parts import Answer, wants_halves
from saf_gen.searches import search_names
from saf_gen.seeds import generator

PAGE = Path(__file__).parents[1] / "docs" / "add-a-method.md"


def counts_of(*shape, highest=50):
    drawn = generator("conformance", *shape).integers(0, highest, shape, dtype=np.uint32)
    drawn.flags.writeable = False
    return drawn


def check_part(part):
    check_class(part)
    assert part.source.strip(), "it cites no source"


def check_class(part):
    cls = type(part)
    assert is_dataclass(cls), "is no dataclass"
    assert cls.__dataclass_params__.frozen, "its dataclass is not frozen"
    written = inspect.getdoc(cls) or ""
    assert not written.startswith(f"{cls.__name__}("), "its class has no docstring"  # dataclass fills it in
    assert written, "its class has no docstring"


def halved(measure):
    """``measure`` as one of whole windows: where it compares halves, it gets the same counts for both."""
    return (lambda counts: measure(np.stack([counts, counts]))) if wants_halves(measure) else measure


def scene():
    """Patches of random counts: neighbours are alike, as in noise they are not. Seven pixels fit no tile."""
    return np.kron(counts_of(9, 9), np.ones((7, 7)))


def check_measure(part):
    """A focus measure keeps its word: a finite float, its degree, and no side effect."""
    check_part(part)
    measure, degree = halved(part), part.degree
    assert type(degree) is int, "degree is no whole number"
    assert degree >= 0, "degree is below 0"
    assert part.score_range.strip(), "it states no range"
    for name, counts in {
        "random": counts_of(37, 52),
        "empty": np.zeros((20, 30), np.uint32),
        "saturated": np.full((20, 30), 20_000, np.uint32),
        "of one pixel": counts_of(1, 1),
        "of one row": counts_of(1, 40),
        "of one column": counts_of(40, 1),
        "of one spike": np.eye(1, 400, 7, dtype=np.uint32).reshape(20, 20),
    }.items():
        score = measure(counts)
        assert isinstance(score, float), f"the score of {name} counts is no float"
        assert math.isfinite(score), f"the score of {name} counts is {score}"
        if name == "empty" and degree == 0:
            assert score == 0.0, "it does not score empty counts 0.0"
    check_that_layout_does_not_matter(measure, counts_of(37, 52))
    # What a measure of halves adds for counting in whole spikes does not scale: there it takes many.
    counts = counts_of(37, 52) * np.uint32(10_000 if wants_halves(part) else 1)
    scaled = measure(counts * np.uint32(3))
    assert scaled == pytest.approx(measure(counts) * 3.0**degree, rel=1e-9), "its degree is wrong"
    sharp = scene()
    blurred = gaussian_filter(sharp, 12.0, mode="wrap")
    assert measure(blurred) <= measure(sharp) * (1 + 1e-9), "it scores a blurred image above the sharp one"


def check_that_layout_does_not_matter(measure, counts):
    before, score = counts.copy(), measure(counts)
    assert measure(counts) == score, "the same counts get another score"
    for other in (np.uint8, np.uint16, np.int16, np.int64, np.float32, np.float64):
        assert measure(counts.astype(other)) == pytest.approx(score, rel=1e-6), (
            f"{other.__name__} changes the score"
        )
    wide = np.repeat(counts, 2, axis=1)[:, ::2]
    assert measure(wide) == measure(np.asfortranarray(counts)) == score, "memory order changes the score"
    writeable = counts.copy()
    measure(writeable)
    assert np.array_equal(writeable, before), "it changes the counts it is given"


class Seen:
    """Exactly what saf_gen.parts.View promises, and a note of how far it was seen."""

    __slots__ = ("_curve", "_seen")

    def __init__(self, curve):
        self._curve, self._seen = curve, 0

    @property
    def frames(self):
        return len(self._curve)

    def score(self, first, stop):
        if not (isinstance(first, int) and isinstance(stop, int) and 0 <= first < stop <= self.frames):
            raise BadInput(f"window of frames {first} to {stop}")
        self._seen = max(self._seen, stop)
        return float(self._curve[first:stop].mean())


def peak(frames, at):
    return np.exp(-(((np.arange(frames) / frames - at) / 0.1) ** 2))


def check_search(search):
    """A search keeps its word: an answer inside the recording, the same each time, for any unit of score."""
    check_part(search)
    assert isinstance(search.causal, bool), "it does not state whether it is causal"
    noise = generator("conformance", "noise").normal(size=3000)
    curves = [peak(frames, at) for frames in (2000, 4999) for at in (0.0, 0.3, 0.5, 0.9, 1.0)]
    for curve in [*curves, noise, -1 - peak(2000, 0.4), np.zeros(2000), np.ones(2000)]:
        answer = search(Seen(curve))
        assert isinstance(answer, Answer), "it does not answer with an Answer"
        if answer.frame is not None:
            assert 0 <= answer.frame <= len(curve) - 1, f"it answers frame {answer.frame} of {len(curve)}"
        assert isinstance(answer.trace, tuple), "its trace is no tuple"
        assert all(math.isfinite(x) for x in answer.trace), "its trace holds no numbers"
        assert len(answer.note.splitlines()) <= 1, "its note is not one line"
        assert search(Seen(curve)) == answer, "the same recording gets another answer"
        assert search(Seen(1024 * curve)) == answer, "the unit of the scores changes the answer"
    for frames in (1, 2, 5, 20):
        try:
            search(Seen(np.ones(frames)))
        except BadInput:
            continue
    early = Seen(peak(5000, 0.3))
    search(early)
    assert not search.causal or early._seen < 5000, "it says it is causal, and needs the whole sweep"


def check_motion(motion, *, first=None):
    """A motion keeps its word: it begins at ``first``, stays in the travel, and does not jump."""
    check_class(motion)
    for duration in (0.5, 1.0):
        times = np.linspace(0, duration, 8001)
        times.flags.writeable = False
        position = motion.positions(times, duration)
        assert position.shape == times.shape, "it does not give a position for each time"
        assert position.dtype == np.float64, "its positions are no float64"
        assert np.isfinite(position).all(), "its positions are not finite"
        assert position.min() >= 0, "it leaves the travel"
        assert position.max() <= 1, "it leaves the travel"
        assert np.array_equal(motion.positions(times, duration), position), (
            "the same times get another motion"
        )
        few = motion.positions(times[5::7], duration)
        assert few == pytest.approx(position[5::7], abs=1e-12), "other readouts see another motion"
        if first is not None:
            assert position[0] == pytest.approx(first, abs=1e-9), "it does not begin where it says"
        widest, half = (np.abs(np.diff(position[::step])).max() for step in (2, 1))
        assert half <= 0.75 * widest + 1e-12, "it jumps"  # twice as many readouts: steps half as wide
        assert readout_positions(motion, 800, 800 / duration).shape == (800,)


MOTIONS = {
    "sweep": {"from": 0.9, "to": 0.2},
    "sweep_and_return": {"from": 0.1, "dwell_s": 0.1},
    "steps": {"count": 6, "natural_hz": 50.0, "damping": 0.15},
    "hand": {"reversals": True, "irregularity": 0.9, "bandwidth_hz": 8.0},
    "from_csv": {"file": {"path": "a.csv", "text": "time_s,position\n0,0.2\n0.3,0.9\n2,0.5\n"}},
    "hold": {"position": 0.4},
}
"""Options that a motion of ours is built with; another's must do without any."""


@pytest.mark.parametrize("name", registry.names("motions"))
def test_a_registered_motion_conforms(name):
    options = MOTIONS.get(name, {})
    check_motion(get_motion(name, **options), first=options.get("from"))


def test_every_motion_of_ours_is_tried_with_options():
    assert set(MOTIONS) == registry._own("motions")


@pytest.mark.parametrize("name", measure_names())
def test_a_registered_measure_conforms(name):
    check_measure(get_measure(name))


@pytest.mark.parametrize("name", search_names())
def test_a_registered_search_conforms(name):
    check_search(get_search(name))


def test_the_paper_s_measures_and_searches_are_registered():
    measures = {"sd", "sd_code", "er_sumsq", "er_count", "gradient_code", "mfdct_code", "mfdct_lee"}
    assert measures <= set(measure_names())
    assert {"argmax", "egs_code", "sgfs_code"} <= set(search_names())


# The page for those who add one: what it shows is run as it stands.


def shown(language):
    return re.findall(
        rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )


@pytest.fixture
def package_of_the_page(tmp_path, monkeypatch):
    """The package that the page describes, as pip would install it; forgotten afterwards."""
    modules = []
    for text in shown("python"):
        name = re.match(r"# (\w+)\.py\n", text)[1]
        modules.append(name)
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    project = tomllib.loads(shown("toml")[0])["project"]
    info = tmp_path / "my_methods-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    groups = [
        "\n".join([f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())])
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(groups))
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    registry._offered.cache_clear()
    registry.part_class.cache_clear()
    yield
    registry._offered.cache_clear()
    registry.part_class.cache_clear()
    for name in modules:
        sys.modules.pop(name, None)


def test_the_files_shown_are_complete_short_and_conform(package_of_the_page):
    assert all(len(text.splitlines()) <= 25 for text in shown("python"))
    assert {"my_measure", "my_measure_n"} <= set(measure_names())
    assert "my_search" in search_names()
    for name in ("my_measure", "my_measure_n"):
        check_measure(get_measure(name))
        assert get_measure(name, apart=2) != get_measure(name)
    check_search(get_search("my_search"))
    assert abs(get_search("my_search", window=50)(Seen(peak(5000, 0.3))).frame - 1500) <= 25


def test_a_package_that_cannot_be_loaded_is_told_and_breaks_no_other(package_of_the_page, tmp_path):
    (tmp_path / "my_measure.py").write_text("import a_module_that_is_nowhere\n")
    assert {"my_measure", "sd", "er_count_n"} <= set(measure_names())
    assert "my_measure_n" not in measure_names()
    for name in ("my_measure", "my_measure_n"):
        with pytest.raises(
            BadInput, match=r"'my_measure' .*cannot be loaded: .*a_module_that_is_nowhere.*mend or"
        ):
            get_measure(name)


# Parts broken on purpose: each must be caught, for its own fault.


def sum_of_squares(self, counts):
    return float((counts.astype(float) ** 2).sum())


def contrast(self, counts, *, empty):
    return float(counts.var() / counts.mean() ** 2) if counts.any() else empty


def scribble(self, counts):
    score = sum_of_squares(self, counts)
    if counts.flags.writeable:
        counts[:] = 0
    return score


def middle(self, view):
    view.score(0, view.frames)
    return Answer((view.frames - 1) / 2)


def blocks(self, view, *, size=50):
    scores = [view.score(first, first + size) for first in range(0, view.frames - size + 1, size)]
    return Answer(scores.index(max(scores)) * size + (size - 1) / 2)


def part_of(members, *, frozen=True):
    return dataclass(frozen=frozen)(
        type("Broken", (), {"__doc__": "Broken.", "source": "this test"} | members)
    )()


def measure_of(call=sum_of_squares, *, frozen=True, **members):
    return part_of({"degree": 2, "score_range": "from 0", "__call__": call} | members, frozen=frozen)


def search_of(call=middle, *, frozen=True, **members):
    return part_of({"causal": False, "__call__": call} | members, frozen=frozen)


def motion_of(positions=None, *, frozen=True, **members):
    return part_of({"positions": positions or way} | members, frozen=frozen)


def way(self, seconds, duration_s):
    return np.asarray(seconds) / duration_s


BROKEN_MEASURES = {
    "its dataclass is not frozen": measure_of(frozen=False),
    "its class has no docstring": measure_of(__doc__=None),
    "it cites no source": measure_of(source=" "),
    "degree is no whole number": measure_of(degree=0.5),
    "it states no range": measure_of(score_range=""),
    "the score of random counts is no float": measure_of(lambda self, c: int((c.astype(int) ** 2).sum())),
    "the score of random counts is inf": measure_of(lambda self, c: math.inf),
    "the score of empty counts is nan": measure_of(partialmethod(contrast, empty=math.nan), degree=0),
    "does not score empty counts 0.0": measure_of(partialmethod(contrast, empty=1.0), degree=0),
    "the same counts get another score": measure_of(
        lambda self, c: sum_of_squares(self, c) * random.random()
    ),
    "it changes the counts": measure_of(scribble),
    "uint8 changes the score": measure_of(lambda self, c: float((c * c).sum(dtype=float))),
    "memory order changes the score": measure_of(
        lambda self, c: float(c.ravel("K")[::2].sum(dtype=float)), degree=1
    ),
    "its degree is wrong": measure_of(degree=1),
    "a blurred image above the sharp one": measure_of(lambda self, c: -sum_of_squares(self, c)),
}
BROKEN_SEARCHES = {
    "its dataclass is not frozen": search_of(frozen=False),
    "it cites no source": search_of(source=""),
    "whether it is causal": search_of(causal="yes"),
    "does not answer with an Answer": search_of(lambda self, view: view.frames / 2),
    "it answers frame 2000.0 of 2000": search_of(lambda self, view: Answer(float(view.frames))),
    "its trace holds no numbers": search_of(lambda self, view: Answer(0.0, (math.nan,))),
    "its note is not one line": search_of(lambda self, view: Answer(None, (), "one\ntwo")),
    "gets another answer": search_of(lambda self, view: Answer(random.random())),
    "the unit of the scores": search_of(lambda self, view: Answer(0.0 if view.score(0, 500) > 0.5 else 1.0)),
    "needs the whole sweep": search_of(middle, causal=True),
}
BROKEN_MOTIONS = {
    "its dataclass is not frozen": motion_of(frozen=False),
    "its class has no docstring": motion_of(__doc__=None),
    "it does not give a position for each time": motion_of(lambda self, t, T: way(self, t, T)[:-1]),
    "its positions are no float64": motion_of(lambda self, t, T: way(self, t, T).astype(np.float32)),
    "its positions are not finite": motion_of(lambda self, t, T: way(self, t, T) * math.nan),
    "it leaves the travel": motion_of(lambda self, t, T: way(self, t, T) * 1.01),
    "the same times get another motion": motion_of(lambda self, t, T: way(self, t, T) * random.random()),
    "other readouts see another motion": motion_of(lambda self, t, T: np.linspace(0.1, 1, len(t))),
    "it does not begin where it says": motion_of(lambda self, t, T: 1 - way(self, t, T)),
    "it jumps": motion_of(lambda self, t, T: np.floor(4 * way(self, t, T)) / 4),
}
CRASHING_SEARCHES = {
    "a window of no frame": (search_of(lambda self, view: Answer(view.score(5, 5))), BadInput),
    "beyond the recording": (search_of(lambda self, view: Answer(view.score(0, view.frames + 1))), BadInput),
    "a fractional window": (search_of(lambda self, view: Answer(view.score(0, view.frames / 2))), BadInput),
    "the truth": (search_of(lambda self, view: Answer(view.truth.frame)), AttributeError),
    "a plain": (
        search_of(lambda self, view: Answer(0 / (view.score(0, 9) - view.score(9, 18)))),
        ZeroDivisionError,
    ),
    "a short recording": (search_of(blocks), ValueError),
}


def test_the_parts_that_the_broken_ones_are_made_of_conform():
    check_measure(measure_of())
    check_measure(measure_of(partialmethod(contrast, empty=0.0), degree=0))
    check_measure(measure_of(lambda self, c: float((c[0].astype(float) * c[1]).sum()), halves=True))
    check_search(search_of())
    check_motion(motion_of(), first=0)


@pytest.mark.parametrize("fault", BROKEN_MOTIONS)
def test_a_broken_motion_is_caught(fault):
    with pytest.raises(AssertionError, match=fault):
        check_motion(BROKEN_MOTIONS[fault], first=0)


@pytest.mark.parametrize("fault", BROKEN_MEASURES)
def test_a_broken_measure_is_caught(fault):
    with pytest.raises(AssertionError, match=fault):
        check_measure(BROKEN_MEASURES[fault])


@pytest.mark.parametrize("fault", BROKEN_SEARCHES)
def test_a_broken_search_is_caught(fault):
    with pytest.raises(AssertionError, match=fault):
        check_search(BROKEN_SEARCHES[fault])


@pytest.mark.parametrize("fault", CRASHING_SEARCHES)
def test_a_search_that_asks_for_what_it_may_not_have_is_caught(fault):
    search, error = CRASHING_SEARCHES[fault]
    with pytest.raises(error):
        check_search(search)
