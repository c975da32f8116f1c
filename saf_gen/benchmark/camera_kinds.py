"""Methods that need what only some cameras see, and recordings by other cameras."""

from collections.abc import Callable, Mapping
from contextlib import suppress

from saf_gen.benchmark.method_spec import Method, nested_plugins, split_options
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.errors import BadInput
from saf_gen.parts import wants_intervals, wants_polarities
from saf_gen.plugins.measures import NORMALISED_SUFFIX
from saf_gen.stream.recordings import open_recording

LAW_OF_SPIKES = frozenset({"sd_calibrated", "sd_debiased", "split_gradient", "structure_calibrated"})
"""Measures that add 1/12 for the spike that two halves of a window share (:mod:`saf_gen.camera.counting_law`). Counts
of single photons and of events share nothing, so that the same addend would be taken for contrast."""
EVENTS_OF_SPIKES = frozenset({"change_rate"})
"""Measures that make events of spikes, and mean nothing where there are events."""
TWINS = {"saf_gen.plugins.searches.pbf": "pbf_events", "saf_gen.plugins.searches.elp": "elp_events"}
"""Modules of searches that make events of spikes, each with the search that takes events as they are."""


def keep_those_that_suit(
    methods: Mapping[str, Method], tasks: list[SequenceTask], *, asked: bool, tell: Callable[[str], None]
) -> dict[str, Method]:
    """Return the methods that suit the camera of the recordings.

    Parameters
    ----------
    methods : mapping of str to Method
        The methods by name.
    tasks : list of SequenceTask
        The sequences.
    asked : bool
        Whether the user has named the methods. Others are left out, with a line.
    tell : callable
        Called with that line.

    Raises
    ------
    BadInput
        If a named method needs spikes, or events, and the recordings hold something else.
    """
    needs = {name: need for name, method in methods.items() if (need := _needs(method))}
    kind = _kind(tasks) if needs or not asked else "spikes"
    unfit = {name: reason for name, need in needs.items() for reason in need if reason in REFUSED[kind]}
    if kind == "frames" and not asked:
        raise BadInput(
            "these recordings hold frames, and windows are numbers of frames", allowed="methods that name their window",
            hint="for example --method sd+argmax:window=3",
        )  # fmt: skip
    if not unfit:
        return dict(methods)
    fit = {name: method for name, method in methods.items() if name not in unfit}
    if asked or not fit:
        name, reason = next(iter(unfit.items()))
        allowed, hint = INSTEAD.get(reason, COUNTS)
        twin = _twin(methods[name])
        raise BadInput(
            f"{name} {reason}, and these recordings hold {WORDS[kind]}", allowed=allowed,
            hint=f"use {twin}" if reason == MADE and twin else hint,
        )  # fmt: skip
    tell(f"left out, because these recordings hold {WORDS[kind]}: {', '.join(unfit)}")
    return fit


LAW, INTERVALS, MADE = "corrects for the noise of spikes", "needs intervals between spikes", "makes events of spikes"
POLARITIES = "needs events with their polarities"
WORDS = {"spikes": "spikes", "photons": "single photons", "events": "events", "frames": "frames"}
REFUSED = {
    "spikes": (POLARITIES,), "photons": (LAW, POLARITIES), "events": (LAW, INTERVALS, MADE),
    "frames": (LAW, INTERVALS, POLARITIES),
}  # fmt: skip
COUNTS = "a measure of counts that corrects for no spikes, such as sd or er_count", "leave the method out"
INSTEAD = {
    POLARITIES: ("recordings of an event camera", "record events with saf-gen recapture"),
    MADE: ("methods that take events as they are", "leave the method out"),
}
"""What may be used where a method is refused, and the next step, by the reason; else COUNTS."""


def _needs(method: Method) -> list[str]:
    """Return why some cameras do not suit a method."""
    name = _plain_name(method.measure_name)
    reasons = {
        POLARITIES: any(map(wants_polarities, nested_plugins(method.search))),
        LAW: name in LAW_OF_SPIKES,
        MADE: name in EVENTS_OF_SPIKES or bool(_twin(method)),
        INTERVALS: wants_intervals(method.measure),
    }
    return [reason for reason, applies in reasons.items() if applies]


def _plain_name(measure: str) -> str:
    """Return the name of a measure without its options and its form."""
    return split_options(measure)[0].removesuffix(NORMALISED_SUFFIX)


def check_law(measure: str, kind: str) -> None:
    """Raise BadInput if a measure corrects for the noise of spikes or makes events of them, and there are none."""
    name = _plain_name(measure)
    reasons = {LAW: name in LAW_OF_SPIKES, MADE: name in EVENTS_OF_SPIKES}
    for reason in (reason for reason, applies in reasons.items() if applies and reason in REFUSED[kind]):
        raise BadInput(f"{measure} {reason}, and this recording holds {WORDS[kind]}", allowed=COUNTS[0], hint=COUNTS[1])


def _twin(method: Method) -> str:
    """Return the search that takes events as they are, for one that makes them of spikes, or ''."""
    return next((twin for plugin in nested_plugins(method.search) if (twin := TWINS.get(type(plugin).__module__))), "")


def _kind(tasks: list[SequenceTask]) -> str:
    """Return what the recordings hold: ``spikes``, ``photons``, ``events`` or ``frames``.

    One camera has recorded them, so that one tells. Only imported ones may hold spikes and photons: this is photons.
    """
    kind = "spikes"
    for task in tasks:
        with suppress(BadInput, OSError), open_recording(task.path) as stream:
            kind = stream.counted
        if kind != "spikes":
            break
    return kind
