"""Checks of a search that estimates on a recording: it ends, answers with a recorded frame, and ignores the unit."""

from collections.abc import Callable
from functools import partial

import numpy as np

from saf_gen.benchmark.conformance._check_runner import (
    UNIT_HINT,
    Check,
    CheckFailure,
    CheckLimits,
    CheckWarning,
    check_answer_frame,
    check_docs,
    check_same_answers,
)
from saf_gen.benchmark.conformance._samples import MEAN_RATE, SyntheticRecording, bell
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.parts import Search, wants_measures
from saf_gen.plugins.measures import get_measure

LENGTHS = 2000, 5000, 20_000, 100_000
"""Lengths of recordings in frames, of which the first is used that the search does not refuse as too short."""
SHORT_LENGTHS = 1, 2, 5, 20, 100
PEAK_FRACTIONS = 0.3, 0.5, 0.7
TOLERANCE = 0.05  # fraction of the recording
UNIT = 1024.0  # a power of two, so that scaled scores are the same to the last bit

ViewFactory = Callable[..., SyntheticRecording]


def estimating_checks(search: Search, limits: CheckLimits) -> dict[str, Check]:
    """Return the checks of a search that works on recordings, by name."""
    checks: dict[str, Callable[[Search, ViewFactory], str]] = {
        "ends": _check_ends,
        "answers": _check_answers,
        "flat": _check_flat,
        "repeatable": _check_repeatable,
        "any unit": _check_any_unit,
        "finds a bell": _check_finds_peak,
        "stops early": _check_stops_early,
        "short": _check_short,
    }
    record = partial(SyntheticRecording, limits=limits)
    return {
        "described": partial(check_docs, search),
        "stated": partial(check_statements, search),
        **{name: partial(check, search, record) for name, check in checks.items()},
    }


def check_statements(search: Search) -> str:
    """Check that the search states whether it is causal, and that all measures that it names exist."""
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
            raise CheckFailure(f"it uses {name!r}: {problem}", "name existing measures") from problem
    others = ", ".join(wants_measures(search))
    return f"causal: {'yes' if causal else 'no'}{f'; also uses {others}' if others else ''}"


def recording_length(search: Search, record: ViewFactory = SyntheticRecording) -> int:
    """Return the first of LENGTHS, in frames, that the search does not refuse; raise CheckFailure if it refuses all."""
    for frames in LENGTHS:
        try:
            search(record(bell(frames, 0.5)))
        except BadInput as problem:
            refusal = problem
        else:
            return frames
    raise CheckFailure(
        f"it refuses a recording of {frames:,} frames: {refusal}",
        "ask for windows 0 <= first < stop <= view.frames, and refuse only recordings that are too short",
    )


def _check_ends(search: Search, record: ViewFactory) -> str:
    """Check that the search ends within the limits on scores and time."""
    costs = []
    for frames in (recording_length(search, record), LENGTHS[-1]):
        view = record(bell(frames, 0.5))
        search(view)
        costs.append(f"{view.scores:,} scores of {frames:,} frames")
    return "; ".join(costs)


def _check_answers(search: Search, record: ViewFactory) -> str:
    """Check that for any curve the search returns an Answer, with a frame of the recording or an abstention."""
    curves = _curves(recording_length(search, record))
    for name, curve in curves.items():
        check_answer_frame(search(record(curve)), len(curve), recording=name)
    return f"an answer in the recording, on {len(curves)} curves: peaks, noise, scores below 0"


def _check_flat(search: Search, record: ViewFactory) -> str:
    """Check that the search does not crash without spikes, if all scores are equal, or if the curve is flat on top."""
    frames = recording_length(search, record)
    answers = []
    for name, (curve, light) in {
        "an empty recording": (np.zeros(frames), 0.0),
        "a constant one": (np.ones(frames), MEAN_RATE),
        "a saturated one": (np.minimum(bell(frames, 0.5), 0.5), 1.0),
    }.items():
        answer = check_answer_frame(search(record(curve, light=light)), frames, recording=name)
        answers.append(f"{name}: {'none' if answer.frame is None else f'frame {answer.frame:g}'}")
    return "; ".join(answers)


def _check_repeatable(search: Search, record: ViewFactory) -> str:
    """Check that the search gives the same answer for the same recording."""
    for name, curve in _curves(recording_length(search, record)).items():
        first, again = search(record(curve)), search(record(curve))
        check_same_answers(first, again, cause=f"the same recording gets another answer, on {name}")
    return "the same recording gets the same answer"


def _check_any_unit(search: Search, record: ViewFactory) -> str:
    """Check that the search gives the same answer for scores in another unit, because each measure has its own unit."""
    for name, curve in _curves(recording_length(search, record)).items():
        plain, scaled = search(record(curve)), search(record(curve, unit=UNIT))
        check_same_answers(plain, scaled, cause=f"scores times {UNIT:g} change the answer, on {name}", hint=UNIT_HINT)
    return f"scores times {UNIT:g} give the same answer"


def _check_finds_peak(search: Search, record: ViewFactory) -> str:
    """Check that the search finds a smooth peak without noise."""
    frames = recording_length(search, record)
    found = [(peak, search(record(bell(frames, peak))).frame) for peak in PEAK_FRACTIONS]
    words = ", ".join(f"{peak} → {'no answer' if at is None else f'{at / frames:.3f}'}" for peak, at in found)
    seen = f"peak of the curve → answer, as fractions of the recording: {words}"
    if any(at is None or abs(at / frames - peak) > TOLERANCE for peak, at in found):
        raise CheckWarning(seen, f"an error within {TOLERANCE:g} is expected for a smooth peak without noise")
    return seen


def _check_stops_early(search: Search, record: ViewFactory) -> str:
    """Check that a search that is stated to be causal does not ask for the end of a sweep with an early peak.

    In the closed loop the lens moves on until the end of the last window that the search asks for. The answer must
    therefore be among the frames recorded until then.
    """
    frames = LENGTHS[-1] // 2
    view = record(bell(frames, PEAK_FRACTIONS[0]))
    answer = search(view)
    seen = f"for a peak at {PEAK_FRACTIONS[0]} of the sweep, it asks for frames up to {view.seen / frames:.3f}"
    if getattr(search, "causal", False) and view.seen >= frames:
        raise CheckFailure(
            f"it states that it is causal, but {seen}",
            "ask for windows in order of time and return at the peak, or state causal = False",
        )
    if answer.frame is not None and answer.frame > view.seen - 0.5:
        raise CheckWarning(
            f"{seen}, and answers a later one, {answer.frame / frames:.3f}",
            "in the closed loop the lens has not been there yet: the answer is limited to the frames so far",
        )
    return seen


def _check_short(search: Search, record: ViewFactory) -> str:
    """Check that the search answers on a short recording, or refuses it with a message of one line."""
    refused = []
    for frames in SHORT_LENGTHS:
        try:
            answer = search(record(np.ones(frames)))
            check_answer_frame(answer, frames, recording=f"a recording of {frames} frames")
        except BadInput:
            refused.append(f"{frames}")
    return f"recordings of {', '.join(refused) or 'no'} frames are refused in one line"


def _curves(frames: int) -> dict[str, np.ndarray]:
    """Return focus curves by name; their lengths are ``frames`` and, for some peaks, an odd number."""
    odd = frames * 5 // 2 - 1
    peaks = {f"a peak at {at:g} of {n:,} frames": bell(n, at) for n in (frames, odd) for at in (0, 0.3, 0.9, 1)}
    noise = make_generator("conformance", "noise").normal(size=frames)
    return {**peaks, "noise": noise, "scores below 0": -1 - bell(frames, 0.4), "ones": np.ones(frames)}
