"""What a method may see and do: the window counts of a recording, or a running camera and its lens."""

from saf_gen.benchmark.view.recording_view import RecordingView
from saf_gen.benchmark.view.window_counts import WindowCounts

__all__ = ["RecordingView", "WindowCounts"]
