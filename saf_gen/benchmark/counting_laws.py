"""Measures that correct for the noise of spikes, and recordings whose counts have another."""

from collections.abc import Callable, Mapping
from contextlib import suppress

from saf_gen.benchmark.method_spec import Method, split_options
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.camera import parse_sensor
from saf_gen.camera.spad import SpadSensor
from saf_gen.errors import BadInput
from saf_gen.plugins.measures import NORMALISED_SUFFIX
from saf_gen.stream.stream_file import open_stream

OF_SPIKES = frozenset({"sd_calibrated", "sd_debiased", "split_gradient", "structure_calibrated"})
"""Measures that add 1/12 for the spike that two halves of a window share (:mod:`saf_gen.camera.counting_law`). Counts
of single photons share nothing, so that the same addend would be taken for contrast."""


def leave_to_spikes(
    methods: Mapping[str, Method], tasks: list[SequenceTask], *, asked: bool, tell: Callable[[str], None]
) -> dict[str, Method]:
    """Return the methods whose law of noise is that of the recordings.

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
        If one of the named methods corrects for the noise of spikes, and the counts are those of single photons.
    """
    unfit = [name for name, method in methods.items() if _measure(method) in OF_SPIKES]
    if not unfit or not _of_photons(tasks):
        return dict(methods)
    fit = {name: method for name, method in methods.items() if name not in unfit}
    if asked:
        raise BadInput(
            f"{unfit[0]} corrects for the noise of spikes, and these counts are of single photons",
            allowed="any measure but " + ", ".join(sorted(OF_SPIKES)),
            hint="sd, for example, needs no such correction",
        )
    tell(f"left out, because they correct for the noise of spikes: {', '.join(unfit)}")
    return fit


def _measure(method: Method) -> str:
    return split_options(method.measure_name)[0].removesuffix(NORMALISED_SUFFIX)


def _of_photons(tasks: list[SequenceTask]) -> bool:
    """Return whether the first recording that says its sensor is of single photons."""
    for task in tasks:
        with suppress(BadInput, OSError), open_stream(task.path) as stream:
            text = stream.metadata.provenance.get("sensor")
            return text is not None and isinstance(parse_sensor(text, "/provenance/sensor"), SpadSensor)
    return False
