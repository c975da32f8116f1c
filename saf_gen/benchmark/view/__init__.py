"""Views through which a method sees a recording, or sees a running camera and moves its lens."""

from saf_gen.benchmark.view.recording_view import RecordingView
from saf_gen.benchmark.view.window_counts import WindowCounts

__all__ = ["RecordingView", "WindowCounts"]
