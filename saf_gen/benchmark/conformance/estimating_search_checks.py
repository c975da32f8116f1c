"""Checks of a search that estimates on a recording: it ends, in the recording, the same for any unit."""

from collections.abc import Callable
from functools import partial

import numpy as np

from saf_gen.benchmark.conformance._answer_checks import check_frame
from saf_gen.benchmark.conformance._check_result import CheckFailure, CheckWarning
from saf_gen.benchmark.conformance._check_runner import Check, CheckLimits
from saf_gen.benchmark.conformance._declaration_checks import described
from saf_gen.benchmark.conformance._synthetic_recording import MEAN_RATE, SyntheticRecording, gaussian_curve
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.measures import get_measure
from saf_gen.parts import Answer, Search, wants_measures

__all__ = ["estimating_checks", "find_accepted_length", "stated"]

LENGTHS = 2000, 5000, 20_000, 100_000
"""Frames of the recordings: the first that is not refused as too short."""
SHORT = 1, 2, 5, 20, 100
PEAK_FRACTIONS = 0.3, 0.5, 0.7
TOLERANCE = 0.05  # of the recording
UNIT = 1024.0  # a power of two, so that scaled scores are the same to the last bit

ViewFactory = Callable[..., SyntheticRecording]


def estimating_checks(search: Search, limits: CheckLimits) -> dict[str, Check]:
    """The checks of one search, by name."""
    look = partial(SyntheticRecording, limits=limits)
    checks = (ends, answers, flat, repeatable, any_unit, finds_a_bell, stops_early, short)
    return {
        "described": partial(described, search),
        "stated": partial(stated, search),
        **{check.__name__.replace("_", " "): partial(check, search, look) for check in checks},
    }


def stated(search: Search) -> str:
    """Whether it is causal; and measures that there are, if it looks through others."""
    causal = getattr(search, "causal", None)
    if not isinstance(causal, bool):
        raise CheckFailure(
            f"it does not state whether it is causal: {causal!r}",
            "add causal: ClassVar[bool] = True if it can stop before the sweep ends, else False",
        )
    for name in wants_measures(search):
        try:
            get_measure(name)
        except BadInput as problem:
            raise CheckFailure(
                f"it looks through {name!r}: {problem}", "name measures that there are"
            ) from problem
    others = ", ".join(wants_measures(search))
    return f"causal: {causal}{f'; looks through {others}, too' if others else ''}".replace(
        "True", "yes"
    ).replace("False", "no")


def find_accepted_length(search: Search, look: ViewFactory = SyntheticRecording) -> int:
    """Frames of the shortest of our recordings that the search does not refuse."""
    for frames in LENGTHS:
        try:
            search(look(gaussian_curve(frames, 0.5)))
        except BadInput as problem:
            refusal = problem
        else:
            return frames
    raise CheckFailure(
        f"it refuses a recording of {frames:,} frames: {refusal}",
        "ask for windows 0 <= first < stop <= view.frames, and refuse only what is too short",
    )


def ends(search: Search, look: ViewFactory) -> str:
    """It ends, within a number of scores and of seconds."""
    told = []
    for frames in (find_accepted_length(search, look), LENGTHS[-1]):
        view = look(gaussian_curve(frames, 0.5))
        search(view)
        told.append(f"{view.scores:,} scores of {frames:,} frames")
    return "; ".join(told)


def answers(search: Search, look: ViewFactory) -> str:
    """An Answer, with a frame of the recording or none, whatever the curve."""
    curves = _curves(find_accepted_length(search, look))
    for name, curve in curves.items():
        check_frame(search(look(curve)), len(curve), name)
    return f"an answer in the recording, on {len(curves)} curves: peaks, noise, scores below 0"


def flat(search: Search, look: ViewFactory) -> str:
    """No crash without a spike, with one score throughout, and where the top of the curve is cut off."""
    frames = find_accepted_length(search, look)
    said = []
    for name, (curve, light) in {
        "an empty recording": (np.zeros(frames), 0.0),
        "a constant one": (np.ones(frames), MEAN_RATE),
        "a saturated one": (np.minimum(gaussian_curve(frames, 0.5), 0.5), 1.0),
    }.items():
        answer = check_frame(search(look(curve, light=light)), frames, name)
        said.append(f"{name}: {_words(answer)}")
    return "; ".join(said)


def repeatable(search: Search, look: ViewFactory) -> str:
    """The same answer for the same recording."""
    for name, curve in _curves(find_accepted_length(search, look)).items():
        first, again = search(look(curve)), search(look(curve))
        if first != again:
            raise CheckFailure(
                f"the same recording gets another answer: {again}, not {first}, on {name}",
                "draw nothing by chance, and keep nothing between calls",
            )
    return "the same recording gets the same answer"


def any_unit(search: Search, look: ViewFactory) -> str:
    """The same answer for scores in another unit: each measure has its own."""
    for name, curve in _curves(find_accepted_length(search, look)).items():
        plain, scaled = search(look(curve)), search(look(curve, unit=UNIT))
        if plain != scaled:
            raise CheckFailure(
                f"scores times {UNIT:g} change the answer: {scaled}, not {plain}, on {name}",
                "the unit of the scores must not matter: compare them with each other, never with a number",
            )
    return f"scores times {UNIT:g} give the same answer"


def finds_a_bell(search: Search, look: ViewFactory) -> str:
    """A smooth peak without noise is found."""
    frames = find_accepted_length(search, look)
    found = [(top, search(look(gaussian_curve(frames, top))).frame) for top in PEAK_FRACTIONS]
    words = ", ".join(f"{top} as {'nothing' if at is None else f'{at / frames:.3f}'}" for top, at in found)
    if any(at is None or abs(at / frames - top) > TOLERANCE for top, at in found):
        raise CheckWarning(
            f"peaks of the curve, shares of the recording: {words}",
            f"within {TOLERANCE:g} is what one expects of a smooth peak without noise",
        )
    return f"peaks of the curve, shares of the recording: {words}"


def stops_early(search: Search, look: ViewFactory) -> str:
    """One that says it is causal has not asked for the end when the peak was early.

    Live the lens goes on to the end of the last window asked for: what was seen until then is all that a
    causal search may need, so its answer lies in it.
    """
    frames = LENGTHS[-1] // 2
    view = look(gaussian_curve(frames, PEAK_FRACTIONS[0]))
    answer = search(view)
    seen = f"on a peak at {PEAK_FRACTIONS[0]} of the sweep it asked for frames up to {view.seen / frames:.3f}"
    if getattr(search, "causal", False) and view.seen >= frames:
        raise CheckFailure(
            f"it says it is causal, and {seen}",
            "ask for windows in their order and return at the peak, or state causal = False",
        )
    if answer.frame is not None and answer.frame > view.seen - 0.5:
        raise CheckWarning(
            f"{seen}, and answers a later one, {answer.frame / frames:.3f}",
            "live, the lens has not been there yet: the answer is cut to what has passed",
        )
    return seen


def short(search: Search, look: ViewFactory) -> str:
    """A recording that is too short is refused in one line, or answered."""
    refused = []
    for frames in SHORT:
        try:
            check_frame(search(look(np.ones(frames))), frames, f"a recording of {frames} frames")
        except BadInput:
            refused.append(f"{frames}")
    return f"recordings of {', '.join(refused) or 'no'} frames are refused in one line"


def _curves(frames: int) -> dict[str, np.ndarray]:
    """Curves of two lengths, the second odd."""
    odd = frames * 5 // 2 - 1
    tops = {
        f"a peak at {at:g} of {n:,} frames": gaussian_curve(n, at)
        for n in (frames, odd)
        for at in (0, 0.3, 0.9, 1)
    }
    noise = make_generator("conformance", "noise").normal(size=frames)
    return {
        **tops,
        "noise": noise,
        "scores below 0": -1 - gaussian_curve(frames, 0.4),
        "ones": np.ones(frames),
    }


def _words(answer: Answer) -> str:
    return "none" if answer.frame is None else f"frame {answer.frame:g}"
