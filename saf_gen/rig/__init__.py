"""The rig: what a method may see and do, on a recording. Truth stays with the referee."""

from saf_gen.rig.counts import Counts
from saf_gen.rig.recording import Recording

__all__ = ["Counts", "Recording"]
