"""Light schedules as recipes write them: a kind, that kind's own keys, and the keys that every kind takes.

    {kind: flicker, depth: 0.3, offset: 0.5}           for all light groups of a scene at once
    {lamp: {kind: flash, at_s: 0.1, peak: 20}, ...}    for each by its name; a group not named stays at gain 1

``offset`` is light that stays, added to the schedule's: the daylight in a room whose lamp flickers.
With ``unit: lux`` every gain of the schedule, offset included, is an illuminance of the target in lux. It is
divided by ``lux_at_gain_1``, the illuminance as the scene has it, which stands on the scene's card.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from saf_gen.core.config import components, registry
from saf_gen.core.config.components import Component
from saf_gen.core.config.document import Document
from saf_gen.core.config.ranges import RANGE_FORMS, is_range
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.parts import Light

__all__ = [
    "RESERVED_GROUP_NAMES",
    "build_light",
    "check_light_groups",
    "draw_schedule",
    "read_schedule",
    "split_by_group",
]

COMMON_KEYS = ("offset", "unit", "lux_at_gain_1")
UNITS = ("ratio", "lux")
GROUP = re.compile(r"[a-z0-9][a-z0-9_-]*")
RESERVED_GROUP_NAMES = frozenset({"geometry", "kind", *RANGE_FORMS})
"""What no light group may be called: a stack's other piece, and the words that begin a schedule."""


@dataclass(frozen=True)
class _Combined:
    """(``light`` + ``offset``) / ``one``."""

    light: Light
    offset: float
    one: float

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Gain seconds from 0 to each time."""
        steady = self.offset * np.asarray(seconds, dtype=np.float64)
        return (self.light.integral(seconds, duration_s) + steady) / self.one


def build_light(
    kind: str,
    /,
    *,
    offset: float = 0.0,
    unit: str = "ratio",
    lux_at_gain_1: float | None = None,
    **options: Any,
) -> Light:
    """The light of a schedule; its gain is 1 where the light is as the scene has it.

    Raises BadInput for an unknown kind or key, for a value that is not allowed, and for a schedule in lux
    where nobody knows how many lux gain 1 is.
    """
    known = registry.option_fields("lights", kind)
    for key in options:
        if key not in known:
            raise unknown(f"key of light schedule {kind!r}:", key, (*known, *COMMON_KEYS))
    light = registry.build("lights", kind, **options)
    if not (isinstance(offset, int | float) and 0 <= offset < inf):
        raise BadInput(f"offset is {offset!r}", allowed="0 or more, added to the gain")
    if unit not in UNITS:
        raise BadInput(f"unit is {unit!r}", allowed=", ".join(UNITS), nearest=closest(unit, UNITS))
    if unit == "lux" and lux_at_gain_1 is None:
        raise BadInput(
            "the schedule is in lux, and nobody says how many lux gain 1 is",
            allowed="illuminance_lux on the scene's card, or lux_at_gain_1 in the schedule",
        )
    if unit == "ratio" and lux_at_gain_1 is not None:
        raise BadInput(f"lux_at_gain_1 is {lux_at_gain_1!r} in a schedule of ratios", hint="add unit: lux")
    one = 1.0 if lux_at_gain_1 is None else lux_at_gain_1
    if not (isinstance(one, int | float) and 0 < one < inf):
        raise BadInput(f"lux_at_gain_1 is {one!r}", allowed="lux, above 0")
    return light if offset == 0 and one == 1 else _Combined(light, offset, one)


def check_light_groups(lights: Mapping[str, Sequence[str]], document: Document) -> None:
    """Check the light groups of a scene's card: each with its emitters.

    Raises BadInput for a name that cannot be a file of a stack, or that a schedule could not say, for a group
    without emitters, and for an emitter in two groups.
    """
    for group, emitters in lights.items():
        where = document.locate("lights", group)
        if not GROUP.fullmatch(group):
            raise BadInput(
                f"a light group is called {group!r}",
                where=where,
                allowed="lower-case letters, digits, - and _, a letter or digit first",
            )
        if group in RESERVED_GROUP_NAMES:
            raise BadInput(
                f"a light group is called {group!r}, which means something else in schedules and stacks",
                where=where,
                allowed=f"any name but {', '.join(sorted(RESERVED_GROUP_NAMES))}",
            )
        if not emitters:
            raise BadInput(
                f"light group {group!r} is empty",
                where=where,
                allowed="the names of at least one emitter",
                hint="remove the group, or name the emitters that belong to it",
            )
    listed = [e for emitters in lights.values() for e in emitters]
    for emitter in listed:
        if listed.count(emitter) > 1:
            raise BadInput(f"emitter {emitter!r} is in two light groups", where=document.locate("lights"))


def split_by_group(schedule: dict[str, Any], where: str = "") -> dict[str, Component]:
    """A light schedule as {light group: part}; the key '' stands for all groups at once."""
    if "kind" in schedule or is_range(schedule):
        return {"": schedule}
    for group, part in schedule.items():
        if not isinstance(part, dict) or not ("kind" in part or is_range(part)):
            raise BadInput(
                f"light group {group!r} has no kind",
                where=where,
                allowed="{kind: ..., ...}, or such a mapping for each light group",
                hint=f"kinds: {', '.join(registry.names('lights'))}",
            )
    return schedule


def read_schedule(schedule: dict[str, Any], document: Document, keys: tuple[str, ...]) -> dict[str, Any]:
    """The schedule at these keys of a recipe, checked, as it was written but with its files read.

    Raises BadInput with file and line where something does not fit.
    """
    parts = split_by_group(schedule, document.locate(*keys))
    if "" in parts:
        return _read(parts[""], document, keys)
    return {group: _read(part, document, (*keys, group)) for group, part in parts.items()}


def _read(part: Component, document: Document, keys: tuple[str, ...]) -> Component:
    return components.read_component("lights", part, document, keys, common=COMMON_KEYS, build=_without_scene)


def _without_scene(kind: str, /, **options: Any) -> Light:
    """The light of a schedule in lux whose scene, which knows what gain 1 is, has not been read yet."""
    if options.get("unit") == "lux":
        options.setdefault("lux_at_gain_1", 1.0)
    return build_light(kind, **options)


def draw_schedule(
    schedule: dict[str, Any], name: tuple[str | int, ...], illuminance_lux: Mapping[str, float]
) -> dict[str, Component]:
    """The parts of one recording by light group, with all that was left open.

    ``name`` names the recording's random streams. ``illuminance_lux`` is the scene's, of the target at gain
    1, by light group.
    """
    parts = {}
    for group, part in split_by_group(schedule).items():
        parts[group] = drawn = components.draw_component("lights", part, name, ("lights", group))
        lux = illuminance_lux.get(group) if group else sum(illuminance_lux.values())
        if lux and drawn.get("unit") == "lux":
            drawn.setdefault("lux_at_gain_1", lux)
    return parts
