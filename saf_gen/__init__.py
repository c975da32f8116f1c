"""Spike-camera autofocus data from physics, and the benchmark that ranks autofocus methods on it.

The names below load on first use: a machine that only evaluates never imports the renderer.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "open_stream": "stream.stream_file",
    "write_stream": "stream.stream_file",
    "get_measure": "measures",
    "get_search": "searches",
    "get_light": "lights",
    "get_motion": "motions",
    "get_sensor": "camera",
    "encode": "camera",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"saf_gen.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'saf_gen' has no attribute {name!r}; it has {', '.join(sorted(__all__))}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
