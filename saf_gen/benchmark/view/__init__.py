"""Views through which a method sees a recording, or sees a running camera and moves its lens."""

from saf_gen.benchmark.view.recording import RecordingView, WindowCounts

__all__ = ["RecordingView", "WindowCounts"]
