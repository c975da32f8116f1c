"""The rig: what a method may see and do, on a recording. Truth stays with the referee."""

from saf_gen.benchmark.view.recording_view import RecordingView
from saf_gen.benchmark.view.window_counts import WindowCounts

__all__ = ["RecordingView", "WindowCounts"]
