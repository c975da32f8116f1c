"""Converts plain XML to the Mitsuba dictionary that the rest of this package uses, and keeps the file's names."""

import re
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.errors import BadInput


def parse_scene_dict(text: str, path: Path) -> dict[str, Any]:
    """Return the Mitsuba dictionary of a scene from :func:`saf_gen.scene.xml.read_scene_xml`, by id.

    A lamp is copied to every shape that refers to it; surfaces, textures and the like stay shared. ``path`` is the
    file, for messages. Raises BadInput if Mitsuba does not understand the scene.
    """
    variant: Any = mi.variant()  # the stubs allow None, but a backend has been activated
    config = mi.parser.ParserConfig(variant)
    config.merge_equivalent = config.merge_meshes = False
    try:
        state = mi.parser.parse_string(config, text)
        mi.parser.transform_all(config, state)
    except (RuntimeError, ValueError, TypeError) as error:
        raise mitsuba_refusal(error, path) from error
    top = [v.index() for _, v in state.root.props.items() if isinstance(v, mi.Properties.ResolvedReference)]
    entries = {state.nodes[i].props.id(): _entry(state, i, shared=frozenset(top)) for i in top}
    return {name: entry for name, entry in entries.items() if entry["type"] != "area"}


def mitsuba_refusal(error: Exception, path: Path) -> BadInput:
    """Return an error of Mitsuba's parser as a BadInput; ``path`` is the file, for messages."""
    message = re.sub(r"^\[[\w.]+:\d+\] ", "", str(error))
    line = re.search(r"line (\d+)", message)
    message = re.sub(r"^Error while loading string \(.*?\): ", "", message)
    return BadInput(f"Mitsuba does not understand this: {message}", where=f"{path}:{line[1]}" if line else str(path))


def _entry(state: Any, index: int, *, shared: frozenset[int]) -> dict[str, Any]:
    """Return the dictionary of a node; nodes in ``shared``, except lamps, become references."""
    props = state.nodes[index].props
    entry: dict[str, Any] = {"type": props.plugin_name()}
    for key, value in props.items():
        key = re.sub(r"^_arg_", "part_", key)
        if isinstance(value, mi.Properties.ResolvedReference):
            inner = value.index()
            lamp = state.nodes[inner].type == mi.ObjectType.Emitter
            if inner in shared and not lamp:
                entry[key] = {"type": "ref", "id": state.nodes[inner].props.id()}
            else:
                entry[key] = _entry(state, inner, shared=shared)
        elif isinstance(value, mi.ScalarAffineTransform4d):  # the parser gives doubles
            entry[key] = mi.ScalarTransform4f(np.array(value.matrix, dtype=np.float64).tolist())
        else:
            entry[key] = value
    return entry
