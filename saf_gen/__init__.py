"""Physically based spike-camera autofocus data, and a benchmark that ranks autofocus methods on it.

The names below are imported on first use, so a machine that only evaluates never loads the renderer.

Functions
---------
open_stream, write_stream
    Read or write a spike stream with its truth (HDF5).
open_events, open_frames
    Read the events, or the frames, that ``saf-gen recapture`` recorded of a sequence.
SpikeWindows
    Windows of a dataset for training a network, read quickly in any order.
get_sensor, encode
    Return a spike camera by name; turn collected charge into spikes.
encode_events
    Turn light into the events of an event camera.
get_light, get_motion, get_measure, get_search
    Return a light schedule, lens motion, focus measure or search by name; :mod:`saf_gen.parts` describes each.
measure
    Turn a function into a focus measure.
sample
    Return the folder of a small dataset that comes with saf_gen.
evaluate
    Run methods, and functions of your own, on a dataset, and return their ranking.
read_leaderboard
    Return the ranking of one or several evaluations, which a notebook shows as a table.
"""

from importlib import import_module
from typing import Any

from saf_gen.core.kernel_cache import choose_kernel_cache

__version__ = "0.1.0"

_HOMES = {
    "open_stream": "stream.stream_file",
    "write_stream": "stream.stream_writer",
    "open_events": "stream.event_file",
    "open_frames": "stream.frame_file",
    "SpikeWindows": "stream.spike_windows",
    "sample": "stream.sample_dataset",
    "get_measure": "plugins.measures",
    "measure": "plugins.measures",
    "get_search": "plugins.searches",
    "get_light": "plugins.lights",
    "get_motion": "plugins.motions",
    "get_sensor": "camera",
    "encode": "camera",
    "encode_events": "camera.events",
    "evaluate": "leaderboard",
    "read_leaderboard": "leaderboard",
}
"""Module that defines each public name, relative to ``saf_gen``."""

__all__ = ["__version__", *_HOMES]

choose_kernel_cache()  # before anything imports numba


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"saf_gen.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'saf_gen' has no attribute {name!r}; it has {', '.join(sorted(__all__))}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
