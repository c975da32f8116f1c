"""Whether methods suit a camera: what they need, what it counts, and the form of its recordings.

Kinds of cameras are open, so no rule names one but ``spikes``, whose noise some measures correct for.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress

from saf_gen.benchmark.method_spec import Method, named_measures, nested_plugins, split_options
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.errors import BadInput
from saf_gen.parts import Measure, wants_intervals, wants_polarities
from saf_gen.plugins.measures import INTERVAL_SUFFIX
from saf_gen.stream.metadata import in_words
from saf_gen.stream.recordings import open_recording

LAW_OF_SPIKES = frozenset({"sd_calibrated", "sd_debiased", "structure_calibrated"})
"""Measures that add 1/12 for the spike that two halves of a window share (:mod:`saf_gen.camera.counting_law`). Counts
of other cameras share nothing, so that the same addend would be taken for contrast."""
EVENTS_OF_SPIKES = {"change_rate": "", "elp": "elp_events", "pbf": "pbf_events"}
"""Measures and searches that make events of counts, each with the search that takes events as they are, or ''."""
INTERVALS, MADE = "needs intervals between spikes", "makes events of spikes"
LAW, POLARITIES = "corrects for the noise of spikes", "needs events with their polarities"
COUNTS = "a measure of counts that corrects for no spikes, such as sd or er_count", "leave the method out"
INSTEAD = {
    MADE: ("methods that take events as they are", "leave the method out"),
    POLARITIES: ("recordings of an event camera", "record events with saf-gen recapture"),
}
"""What may be used in place of a method, and the next step, by what it needs; else COUNTS."""


def keep_those_that_suit(
    methods: Mapping[str, Method], tasks: list[SequenceTask], *, asked: Collection[str], tell: Callable[[str], None]
) -> dict[str, Method]:
    """Return the methods that suit the camera of the recordings.

    Parameters
    ----------
    methods : mapping of str to Method
        The methods by name.
    tasks : list of SequenceTask
        The sequences.
    asked : collection of str
        Names of the methods that the user has named. Others are left out, with a line.
    tell : callable
        Called with that line.

    Raises
    ------
    BadInput
        If a named method needs spikes, or events, and the recordings hold something else.
    """
    others = methods.keys() - asked
    if not others and not any(map(_needs, methods.values())):
        return dict(methods)
    kind, form = _camera_of(tasks)
    if form == "frames" and others:
        problem = f"these recordings hold {in_words(kind)}, and windows are numbers of frames"
        hint = "for example --method sd+argmax:window=3"
        raise BadInput(problem, allowed="methods that name their window", hint=hint)
    misfits = {name: error for name, method in methods.items() if (error := method_misfit(method, kind, form=form))}
    refused = [error for name, error in misfits.items() if name in asked or len(misfits) == len(methods)]
    if refused:
        raise refused[0]
    if misfits:
        tell(f"left out, because these recordings hold {in_words(kind)}: {', '.join(misfits)}")
    return {name: method for name, method in methods.items() if name not in misfits}


def method_misfit(method: Method, kind: str, *, form: str, holder: str = "these recordings hold") -> BadInput | None:
    """Return the error that says why a method does not suit a camera, or None if it does.

    Parameters
    ----------
    method : Method
        The method.
    kind : str
        What the camera counts: ``spikes``, ``photons``, or that of any other camera.
    form : str
        Form of its recordings: ``bits``, ``events`` or ``frames``.
    holder : str
        Words before the kind in the error.

    Returns
    -------
    BadInput or None
        The error, which names the method, what may be used in its place, and the next step.
    """
    needs = _needs(method)
    need = next((need for need in needs if _lacks(need, kind, form=form)), None)
    if need is None:
        return None
    allowed, hint = INSTEAD.get(need, COUNTS)
    if need == MADE and (twin := EVENTS_OF_SPIKES.get(_names(method)[1])):
        hint = f"use {twin}"
    by = f"scores by {needs[need]}, which " if needs[need] else ""
    return BadInput(f"{method.name} {by}{need}, and {holder} {in_words(kind)}", allowed=allowed, hint=hint)


def measure_misfit(
    measure: str | Measure, kind: str, *, form: str, holder: str = "this recording holds"
) -> BadInput | None:
    """Return the error that says why a measure, or that of a name, does not suit a camera, or None if it does.

    The other parameters are those of :func:`method_misfit`.
    """
    name = measure if isinstance(measure, str) else type(measure).__module__.rpartition(".")[2]
    for need in _needs_of_measure(name):
        if _lacks(need, kind, form=form):
            return BadInput(f"{name} {need}, and {holder} {in_words(kind)}", allowed=COUNTS[0], hint=COUNTS[1])
    return None


def _needs(method: Method) -> dict[str, str]:
    """Return what a method needs that some cameras lack, in the order in which it is said.

    By each need stands the measure that has it, if the search names it, or ''.
    """
    measure, search = _names(method)
    needs = dict.fromkeys([INTERVALS] if wants_intervals(method.measure) else [], "")
    if search in EVENTS_OF_SPIKES:
        needs[MADE] = ""
    for name, by in ((measure, ""), *((other, other) for other in named_measures(method.search))):
        for need in _needs_of_measure(name):
            needs.setdefault(need, by)
    if any(map(wants_polarities, nested_plugins(method.search))):
        needs[POLARITIES] = ""
    return needs


def _needs_of_measure(name: str) -> Iterator[str]:
    plain = split_options(name)[0]
    if plain.endswith(INTERVAL_SUFFIX):
        yield INTERVALS
    if plain in EVENTS_OF_SPIKES:
        yield MADE
    if plain in LAW_OF_SPIKES:
        yield LAW


def _lacks(need: str, kind: str, *, form: str) -> bool:
    """Return whether a camera cannot give what is needed."""
    if need == LAW:
        return kind != "spikes"
    return {INTERVALS: form != "bits", MADE: form == "events", POLARITIES: form != "events"}[need]


def _names(method: Method) -> tuple[str, str]:
    """Return the names of a method's measure and search without their options."""
    if method.guest is not None:
        return method.guest.names
    return split_options(method.measure_name)[0], method.search_name


def _camera_of(tasks: list[SequenceTask]) -> tuple[str, str]:
    """Return what the camera of the recordings counts, and their form.

    One camera has recorded them, so that one tells. Only imported ones may hold spikes and photons: this is photons.
    """
    camera = "spikes", "bits"
    for task in tasks:
        with suppress(BadInput, OSError), open_recording(task.path) as stream:
            camera = stream.counted, stream.form
        if camera[0] != "spikes":
            break
    return camera
