"""Measures that need the spikes of a spike camera, and recordings by other cameras."""

from collections.abc import Callable, Mapping
from contextlib import suppress

from saf_gen.benchmark.method_spec import Method, split_options
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.camera import parse_sensor
from saf_gen.camera.spad import SpadSensor
from saf_gen.errors import BadInput
from saf_gen.parts import wants_intervals
from saf_gen.plugins.measures import NORMALISED_SUFFIX
from saf_gen.stream.frame_file import FrameFile
from saf_gen.stream.recordings import EventRecording, open_recording

LAW_OF_SPIKES = frozenset({"sd_calibrated", "sd_debiased", "split_gradient", "structure_calibrated"})
"""Measures that add 1/12 for the spike that two halves of a window share (:mod:`saf_gen.camera.counting_law`). Counts
of single photons and of events share nothing, so that the same addend would be taken for contrast."""
EVENTS_OF_SPIKES = frozenset({"change_rate"})
"""Measures that make events of spikes, and mean nothing where there are events."""


def leave_to_spikes(
    methods: Mapping[str, Method], tasks: list[SequenceTask], *, asked: bool, tell: Callable[[str], None]
) -> dict[str, Method]:
    """Return the methods whose measure suits the camera of the recordings.

    Parameters
    ----------
    methods : mapping of str to Method
        The methods by name.
    tasks : list of SequenceTask
        The sequences, which one camera has recorded: the first that can be read tells which.
    asked : bool
        Whether the user has named the methods. Others are left out, with a line.
    tell : callable
        Called with that line.

    Raises
    ------
    BadInput
        If a named method needs spikes, and the recordings hold single photons or events.
    """
    needs = {name: need for name, method in methods.items() if (need := _need(method))}
    kind = _kind(tasks) if needs or not asked else "spikes"
    unfit = [name for name, need in needs.items() if need in REFUSED[kind]]
    if kind == "frames" and not asked:
        raise BadInput(
            "these recordings hold frames, and windows are numbers of frames", allowed="methods that name their window",
            hint="for example --method sd+argmax:window=3",
        )  # fmt: skip
    if kind == "spikes" or not unfit:
        return dict(methods)
    fit = {name: method for name, method in methods.items() if name not in unfit}
    if asked or not fit:
        raise BadInput(
            f"{unfit[0]} {needs[unfit[0]]}, and these recordings hold {WORDS[kind]}",
            allowed="a measure of counts that corrects for no spikes, such as sd or er_count",
            hint="leave the method out",
        )
    tell(f"left out, because these recordings hold {WORDS[kind]}: {', '.join(unfit)}")
    return fit


LAW, INTERVALS, MADE = "corrects for the noise of spikes", "needs intervals between spikes", "makes events of spikes"
WORDS = {"photons": "single photons", "events": "events", "frames": "frames"}
REFUSED = {
    "spikes": (), "photons": (LAW,), "events": (LAW, INTERVALS, MADE), "frames": (LAW, INTERVALS)
}  # fmt: skip


def _need(method: Method) -> str:
    """Return what of spikes a method needs, or ''."""
    name = split_options(method.measure_name)[0].removesuffix(NORMALISED_SUFFIX)
    if name in LAW_OF_SPIKES:
        return LAW
    if name in EVENTS_OF_SPIKES:
        return MADE
    return INTERVALS if wants_intervals(method.measure) else ""


def _kind(tasks: list[SequenceTask]) -> str:
    """Return what the first recording that can be read holds: ``spikes``, ``photons``, ``events`` or ``frames``."""
    for task in tasks:
        with suppress(BadInput, OSError), open_recording(task.path) as stream:
            if isinstance(stream, EventRecording):
                return "events"
            if isinstance(stream, FrameFile):
                return "frames"
            text = stream.metadata.provenance.get("sensor")
            of_photons = text is not None and isinstance(parse_sensor(text, "/provenance/sensor"), SpadSensor)
            return "photons" if of_photons else "spikes"
    return "spikes"
