"""Finished recordings on disk: their fingerprints, whether a file has a given one, and whether it is undamaged."""

import hashlib
import math
from pathlib import Path

from saf_gen.core.config.json_document import load_plain_json
from saf_gen.errors import BadInput
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import SpikeStream, open_stream


def fingerprint_generated_recording(planned: str, truth: Truth, *, mean_rate: float | None) -> str:
    """Return the fingerprint that a recording stores, from the fingerprint of its plan.

    It is that of the plan, except for a moving scene with a mean rate whose lens never meets the focus. The first files
    of such sequences have light for a picture in which the target was elsewhere, so they must be made again. Whether
    the lens meets the focus is known only once the scene is rendered; a higher MODEL would condemn all other files too.

    Parameters
    ----------
    planned : str
        Fingerprint of the plan.
    truth : Truth
        True focus of the recording.
    mean_rate : float or None
        Spikes per readout for which the light was scaled; None for the absolute exposure.
    """
    if truth.track is None or math.isfinite(truth.frame) or mean_rate is None:
        return planned
    return fingerprint_generated_out_of_focus(planned)


def fingerprint_generated_out_of_focus(planned: str) -> str:
    """Return the fingerprint of a recording with a mean rate of a moving scene that is never in focus."""
    return hashlib.sha256(f"{planned} with light for the picture of the target mask".encode()).hexdigest()


def has_generated_fingerprint(stream: SpikeStream, planned: str) -> bool:
    """Return whether a stream has the fingerprint that a recording of this plan stores."""
    provenance = stream.metadata.provenance
    stored = provenance.get("fingerprint")
    if stored != planned:
        return stored == fingerprint_generated_out_of_focus(planned)
    try:
        mean_rate = load_plain_json(provenance["sequence"])["mean_rate"]
    except (KeyError, TypeError, ValueError):  # not written by this package
        return False
    return stored == fingerprint_generated_recording(planned, stream.truth, mean_rate=mean_rate)


def has_generated_recording(path: Path, planned: str) -> bool:
    """Return whether ``path`` is a recording of the plan with this fingerprint; its spikes are not read."""
    return _stored_digest(path, planned, verify=False) is not None


def digest_generated_recording(path: Path, planned: str) -> str | None:
    """Return the content_sha256 of a recording, or None if it is of another plan, missing or damaged.

    All spikes are read.
    """
    return _stored_digest(path, planned, verify=True)


def _stored_digest(path: Path, planned: str, *, verify: bool) -> str | None:
    if not path.is_file():
        return None
    try:
        with open_stream(path) as stream:
            if not has_generated_fingerprint(stream, planned):
                return None
            if verify:
                stream.verify()
            return stream.content_sha256
    except BadInput:
        return None
