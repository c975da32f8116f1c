"""The conformance checks find faults: plug-ins are broken on purpose, and each is caught for its own fault."""

import math
import random
import re
import threading
import warnings
from dataclasses import dataclass
from functools import partialmethod
from time import sleep

import numpy as np
import pytest
from own_plugins import PARTS
from refusals import refusal

from saf_gen import get_measure, get_search
from saf_gen.benchmark.conformance import CheckLimits, check_by_name, check_measure, check_method, check_search
from saf_gen.benchmark.conformance._samples import BEST_FOCUS, TARGET_RATE, SyntheticRecording, bell, write_recordings
from saf_gen.benchmark.method_spec import Method, TunedMethod, TuningTrial, format_tuned, parse_method, resolve_name
from saf_gen.errors import BadInput
from saf_gen.parts import Answer
from saf_gen.stream.stream_file import open_stream

SOON = CheckLimits(scores=50_000)  # ten times as many as the sound searches here need
HERE = r"\(test_conformance_checks.py, line \d+\)"
BRIEF = CheckLimits(seconds=0.5)  # for plug-ins that never end


def describe(value):
    """Return the id of a case: its check and words."""
    return value if isinstance(value, str) else ""


def sum_of_squares(self, counts):
    return float((counts.astype(float) ** 2).sum())


def contrast(self, counts, *, empty):
    return float(counts.var() / counts.mean() ** 2) if counts.any() else empty


def scribble(self, counts):
    score = sum_of_squares(self, counts)
    if counts.flags.writeable:
        counts[:] = 0
    return score


def warning(self, counts):
    warnings.warn("it is late", RuntimeWarning, stacklevel=1)
    return sum_of_squares(self, counts)


def hang(self, counts):
    while True:
        sleep(0.01)


KEPT = []


def with_a_memory(self, counts):
    KEPT.append(float(counts.sum()))
    return sum_of_squares(self, counts) + (KEPT[-1] != KEPT[max(len(KEPT) - 2, 0)])


def plug_in_of(members, *, frozen=True):
    return dataclass(frozen=frozen)(type("Broken", (), {"__doc__": "Broken.", "source": "this test"} | members))()


def measure_of(call=sum_of_squares, *, frozen=True, **members):
    return plug_in_of({"degree": 2, "score_range": "from 0", "__call__": call} | members, frozen=frozen)


class Plain:
    """A class that is not a dataclass."""


BROKEN_MEASURES = [
    ("described", "its dataclass is not frozen", measure_of(frozen=False)),
    ("described", "it has no docstring", measure_of(__doc__=None)),
    ("described", "it cites no source", measure_of(source=" ")),
    ("described", "it is not a dataclass", Plain()),
    ("stated", "its degree is 0.5", measure_of(degree=0.5)),
    ("stated", "its degree is -1, below 0", measure_of(degree=-1)),
    ("stated", "it states no range", measure_of(score_range="")),
    *(("stated", f"its cost is {cost!r}", measure_of(cost=cost)) for cost in (0.0, "cheap")),
    ("finite", "random counts is not a float: int", measure_of(lambda s, c: int((c.astype(int) ** 2).sum()))),
    ("finite", "empty counts is nan", measure_of(partialmethod(contrast, empty=math.nan), degree=0)),
    ("finite", r"IndexError: .*for one-pixel counts \(1, 1\)", measure_of(lambda s, c: float(c[0, 1]))),
    ("finite", rf"CodeStopped: its code called exit\(3\) .*{HERE}, for random", measure_of(lambda s, c: exit(3))),
    ("zero when empty", "score 1.0", measure_of(partialmethod(contrast, empty=1.0), degree=0)),
    ("repeatable", "get another score after others", measure_of(with_a_memory)),
    ("leaves input", "it changes the counts", measure_of(scribble)),
    ("number types", "uint8 changes the score", measure_of(lambda s, c: float((c * c).sum(dtype=float)))),
    ("memory layout", "by columns", measure_of(lambda s, c: float(c.ravel("K")[::2].sum(dtype=float)))),
    ("degree", "degree 2, but it states 1", measure_of(degree=1)),
    ("degree", "no power of brightness", measure_of(lambda s, c: 6e4 - float(c.sum(dtype=float)))),
]


def assert_caught(results, name, level, words):
    """Assert that one result of this check and level matches ``words`` and gives advice; return all results."""
    found = list(results)
    caught = [f for f in found if (f.check, f.level) == (name, level) and re.search(words, f.text)]
    assert len(caught) == 1, found
    assert caught[0].to_do
    assert all("\n" not in f.text + f.to_do for f in found)
    return found


# Estimating searches


def best_block(self, view, *, size=50):
    if view.frames < size:
        raise BadInput("too short")
    scores = [view.score(first, first + size) for first in range(0, view.frames - size + 1, size)]
    return Answer(scores.index(max(scores)) * size + (size - 1) / 2)


def crashing_when_short(self, view):
    scores = [view.score(first, first + 50) for first in range(0, view.frames - 49, 50)]
    return Answer(scores.index(max(scores)) * 50 + 24.5)


def centroid(self, view):
    """Answer with the centroid of the curve, which does not exist without spikes."""
    scores = [view.score(first, first + 20) ** 2 for first in range(0, max(view.frames - 20, 1), 20)]
    at = 20 * sum(i * score for i, score in enumerate(scores)) / sum(scores)
    return Answer(min(at, view.frames - 1.0))


def first_fall(self, view):
    """Answer at the first fall of the score, without looking ahead."""
    if view.frames < 100:
        raise BadInput("too short")
    step = view.frames // 50
    before = view.score(0, step)
    for first in range(step, view.frames - step, step):
        now = view.score(first, first + step)
        if now < before:
            return Answer(first - step / 2)
        before = now
    return Answer(view.frames - 1)


def asks_ahead(self, view):
    view.position(view.frames - 1)
    return first_fall(self, view)


def extrapolated(self, view):
    answer = first_fall(self, view)
    return Answer(min(answer.frame * 1.5, view.frames - 1))


def endless(self, view):
    while True:
        try:
            view.score(0, view.frames)
        except Exception:  # noqa: BLE001
            continue


def search_of(call=best_block, *, frozen=True, **members):
    return plug_in_of({"causal": False, "__call__": call} | members, frozen=frozen)


def answering(wrap):
    """Return ``best_block`` with a changed answer."""
    return search_of(lambda self, view: wrap(best_block(self, view), view))


BROKEN_SEARCHES = [
    ("described", "its dataclass is not frozen", search_of(frozen=False)),
    ("stated", "whether it is causal: 'yes'", search_of(causal="yes")),
    ("stated", "it uses 'sdd': .*'sd'", search_of(measures=("sdd",))),
    ("ends", "did not end within 50,000 scores; the remaining", search_of(endless)),
    ("ends", "it refuses .*0 to 100001 were", search_of(lambda s, v: Answer(v.score(0, v.frames + 1)))),
    ("answers", "it answers with float", answering(lambda a, view: a.frame)),
    ("answers", "it answers frame 2000 of 2,000", answering(lambda a, view: Answer(view.frames))),
    ("answers", "it answers frame nan", answering(lambda a, view: Answer(math.nan))),
    ("answers", "its trace is no flat tuple", answering(lambda a, view: Answer(0.0, (math.nan,)))),
    ("answers", "its note is", answering(lambda a, view: Answer(None, (), "one\ntwo"))),
    ("answers", "it answers with a position, but does not", answering(lambda a, view: Answer(position=0.5))),
    ("flat", "ZeroDivisionError", search_of(centroid)),
    ("repeatable", "gets another answer", answering(lambda a, view: Answer(random.random()))),
    ("any unit", "times 1024", answering(lambda a, view: Answer(0.0 if view.score(0, 500) > 0.05 else 1.0))),
    ("stops early", "it states that it is causal.*1.000", search_of(asks_ahead, causal=True)),
    ("short", "ValueError: .*empty", search_of(crashing_when_short)),
]


@pytest.mark.parametrize(("name", "words", "plug_in"), BROKEN_MEASURES, ids=describe)
def test_a_broken_measure_is_caught(name, words, plug_in):
    assert_caught(check_measure(plug_in, SOON), name, "error", words)


@pytest.mark.parametrize(("name", "words", "plug_in"), BROKEN_SEARCHES, ids=describe)
def test_a_broken_search_is_caught(name, words, plug_in):
    assert_caught(check_search(plug_in, SOON), name, "error", words)


@pytest.mark.parametrize(
    ("check", "name", "words", "plug_in"),
    [
        (check_measure, "sharp over blurred", "more than", measure_of(lambda s, c: -sum_of_squares(s, c))),
        (check_measure, "speed", "RuntimeWarning: it is late", measure_of(warning)),
        (check_search, "finds a bell", "0.3 → 0.500", answering(lambda a, view: Answer(view.frames // 2))),
        (check_search, "finds a bell", "0.3 → no answer", search_of(lambda s, v: Answer(None))),
        (check_search, "stops early", "answers a later one", search_of(extrapolated, causal=True)),
    ],
)
def test_a_doubtful_plug_in_is_warned_of(check, name, words, plug_in):
    found = assert_caught(check(plug_in, SOON), name, "warning", words)
    assert "error" not in {result.level for result in found}


# Lens-commanding searches


def scan(self, view, *, positions=(0.0, 0.2, 0.4, 0.6, 0.8, 1.0)):
    """Score some positions of the travel, and answer with the best."""
    seen = []
    for position in positions:
        view.move(position)
        if view.frames - view.now < 4100:
            break
        view.wait(4000)
        seen.append((view.score(view.now, view.now + 100), position))
    return Answer(position=max(seen)[1]) if seen else Answer(None, (), "out of frames")


def commanding(call, **members):
    return search_of(call, commands=True, **members)


def moving(wrap):
    """Return ``scan`` with a changed answer."""
    return commanding(lambda self, view: wrap(scan(self, view)))


def hopeless(self, view):
    """Wait for ever, and ignore any error."""
    view.move(0.5)
    while True:
        try:
            view.wait(8)
        except Exception:  # noqa: BLE001
            sleep(0.001)


def in_the_past(self, view):
    """Score one past window for ever."""
    view.move(0.5)
    view.wait(8)
    while True:
        view.score(0, 8)


def in_daylight(self, view):
    view.move(0.5)
    view.wait(8)
    if view.score(0, 8, "er_count") < 500:
        raise ValueError("dark")
    return scan(self, view)


def minding_the_unit(self, view):
    answer = scan(self, view)
    return Answer(position=0.2) if answer.position and view.score(0, 800) > 1 else answer


IN_TIME = "stays in travel and budget"
BROKEN_LENS_SEARCHES = [
    ("not on a recording", "it answers Answer", commanding(lambda s, v: Answer(position=0.5))),
    (IN_TIME, "sent to 1.2; .*with hand and 40,000", commanding(lambda s, v: scan(s, v, positions=(0.5, 1.2)))),
    (IN_TIME, "position 1.5", moving(lambda answer: Answer(position=1.5))),
    (IN_TIME, "it answers with a frame", moving(lambda answer: Answer(1.0, position=0.5))),
    (IN_TIME, "exceeds the budget", commanding(lambda s, v: [v.move(0.5), v.wait(40_008), Answer(position=0.5)])),
    ("little time", "without a score", moving(lambda a: Answer(position=a.position or 0.5))),
    ("lights", f"ValueError: dark {HERE}, with voice_coil_hall", commanding(in_daylight)),
    ("repeatable", "another answer", moving(lambda a: Answer(position=a.position and random.random()))),
    ("any unit", "scores times 1024 change the answer", commanding(minding_the_unit)),
]


@pytest.mark.parametrize(("name", "words", "plug_in"), BROKEN_LENS_SEARCHES, ids=describe)
@pytest.mark.slow
def test_a_broken_search_with_the_lens_is_caught(name, words, plug_in):
    assert_caught(check_search(plug_in, SOON), name, "error", words)


@pytest.mark.slow
def test_a_search_with_the_lens_that_finds_nothing_is_warned_of():
    plug_in = moving(lambda answer: Answer(position=None if answer.position is None else 0.5))
    assert_caught(check_search(plug_in), "finds the focus", "warning", "0 → 0.5.*, 1 → 0.5")


@pytest.mark.slow
def test_the_plug_ins_that_the_broken_ones_are_made_of_conform():
    checked = [
        *map(check_measure, [measure_of(), measure_of(partialmethod(contrast, empty=0.0), degree=0)]),
        check_measure(measure_of(lambda s, c: float((c[0].astype(float) * c[1]).sum()), halves=True)),
        check_search(search_of()),
        check_search(search_of(first_fall, causal=True)),
        check_search(commanding(scan)),
    ]
    for results in checked:
        assert {result.level for result in results} == {"ok"}


# Complete methods


def method_of(search, measure="sd"):
    return Method("broken", get_measure(measure), search, code="")


def wants_positions(self, view):
    return Answer(int(best_block(self, view).frame + 0 * view.position(0)))


def wants_later_positions(self, view):
    view.position(view.frames - 1)
    return best_block(self, view)


METHODS = [
    ("recordings", "ValueError: cannot convert float NaN", search_of(wants_positions)),
    ("running camera", r"BadInput: frame \d+ has not passed", search_of(wants_later_positions)),
]


@pytest.mark.parametrize(("name", "words", "plug_in"), METHODS, ids=describe)
@pytest.mark.slow
def test_a_broken_method_is_caught(name, words, plug_in):
    found = assert_caught(check_method(method_of(plug_in)), name, "error", words)
    assert {f.level for f in found if f.part != "method"} == {"ok"}


@pytest.mark.slow
def test_a_method_that_misses_the_focus_of_a_sweep_is_warned_of():
    def tenth(search, view):
        answer = best_block(search, view)
        return answer if isinstance(view, SyntheticRecording) else Answer(view.frames // 10)

    found = assert_caught(
        check_method(method_of(search_of(tenth))), "recordings", "warning", "swept 0.100; focus at 0.4"
    )
    assert_caught(found, "running camera", "warning", "ends at a usual light: 0.(09|10)")


def test_a_method_is_not_tried_where_a_half_of_it_fails():
    found = list(check_method(Method("broken", measure_of(degree=1), search_of(), code="")))
    assert [(f.check, f.level) for f in found if f.part == "method"] == [("whole", "warning")]


@pytest.mark.parametrize("name", ["gradient_code_n_tfi+sgfs_causal", "sd_debiased+coarse_to_fine"])
@pytest.mark.slow
def test_methods_of_ours_conform(name):
    found = list(check_by_name(name))
    assert {f.part for f in found} == {"measure", "search", "method"}
    assert {f.level for f in found} == {"ok"}, found


# The recordings and textures of the checks


def test_recordings_of_the_test_scene_show_what_they_are_named_for(tmp_path):
    rates = {}
    for name, path in write_recordings(tmp_path, 2001).items():
        with open_stream(path) as stream:
            assert stream.shape[0] == 2001
            rates[name] = stream.counts(0, 2001).mean() / 2001
            assert (stream.focus_position is None) == (name in ("empty", "full"))
            if name == "swept":
                windows = [stream.counts(a, a + 200) for a in range(0, 2000, 200)]
                sharpness = [w.var() / w.mean() ** 2 for w in windows]
                assert abs(np.argmax(sharpness) * 0.1 + 0.05 - BEST_FOCUS) <= 0.1
    assert rates["empty"] == 0
    assert rates["full"] == 1
    assert rates["saturated"] > 0.95
    assert rates["swept"] == pytest.approx(TARGET_RATE, rel=0.05)


def test_a_synthetic_recording_scores_the_mean_of_its_curve_and_named_measures_by_a_texture():
    view = SyntheticRecording(bell(1000, 0.4), unit=2.0)
    assert view.score(100, 500) == pytest.approx(2 * bell(1000, 0.4)[100:500].mean(), rel=1e-12)
    assert (view.now, view.scores) == (500, 1)
    assert view.score(350, 450, "sd") > 5 * view.score(600, 700, "sd")
    assert view.score(0, 200, "er_count") == pytest.approx(2 * view.score(0, 100, "er_count"), rel=0.01)
    assert "990 to 1001" in refusal(view.score, 990, 1001).problem
    assert "cannot be moved" in refusal(view.move, 0.5).problem


@pytest.mark.parametrize(
    ("findings", "name"),
    [
        (check_measure(measure_of(hang), BRIEF), "finite"),
        (check_search(commanding(hopeless), BRIEF), "stays in travel and budget"),
    ],
)
def test_a_plug_in_that_hangs_is_stopped_by_the_clock(findings, name):
    found = assert_caught(findings, name, "error", "did not end within 0.5 s; the remaining")
    assert found[-1].check == name


def test_a_search_that_scores_the_past_for_ever_is_stopped():
    findings = check_search(commanding(in_the_past), CheckLimits(scores=1000))
    assert_caught(findings, "stays in travel and budget", "error", "did not end within 1,000 scores")


def test_a_loop_without_end_is_stopped_by_the_number_of_scores_in_a_thread_too():
    """The time limit works only in the main thread."""
    found = []
    thread = threading.Thread(target=lambda: found.extend(check_search(search_of(endless), SOON)))
    thread.start()
    thread.join()
    assert "50,000 scores" in found[-1].text


# Names


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(PARTS + "\n\n@dataclass(frozen=True)\nclass Nothing:\n    pass\n")
    return path


def test_a_name_is_a_method_or_a_half_of_one(own, tmp_path):
    assert resolve_name("sd+argmax") == parse_method("sd+argmax")
    assert resolve_name("argmax:window=50") == ("searches", get_search("argmax", window=50))
    assert resolve_name("sd") == ("measures", get_measure("sd"))
    assert resolve_name("variance_n_tfi") == ("measures", get_measure("variance_n_tfi"))
    for suffix in ("", "_n", "_tfi"):
        assert resolve_name(f"{own}:Range{suffix}")[0] == "measures"
    assert resolve_name(f"{own}:Middle")[0] == "searches"
    tuned = tmp_path / "best.json"
    trial = TuningTrial("sd+argmax:window=50", 1.0, 0.1)
    tuned.write_text(
        format_tuned(TunedMethod(trial.method, "d", "train", "recorded", "", "target", 1, "0", "0", (trial,)))
    )
    assert resolve_name(f"@{tuned}").search.window == 50


@pytest.mark.parametrize(
    ("name", "problem", "nearest"),
    [
        ("sdd", "'sdd'", "sd"),
        ("@nowhere.json", "does not exist", ""),
        ("{own}:Nothing", "neither a measure nor a search", ""),
        ("{own}:Rnge", "has no 'Rnge'", "Range"),
        ("", "''", ""),
    ],
)
def test_a_name_that_is_neither_is_refused(own, name, problem, nearest):
    error = refusal(check_by_name, name.format(own=own))
    assert problem in error.problem
    assert nearest in str(error)
