"""Light schedules: the gain of each light group of a scene over the course of a recording.

Each kind of schedule is a file of this folder, or comes from a package with the entry point ``saf_gen.lights``.
"""

from saf_gen.plugins.lights._schedule import (
    COMMON_KEYS,
    RESERVED_GROUP_NAMES,
    UNITS,
    Lamp,
    Schedule,
    check_groups,
    draw_schedule,
    gains_at_readouts,
    get_light,
    group_gains,
    list_lamps,
    read_schedule,
    split_schedule,
    states_spectrum,
)

__all__ = [
    "COMMON_KEYS",
    "RESERVED_GROUP_NAMES",
    "UNITS",
    "Lamp",
    "Schedule",
    "check_groups",
    "draw_schedule",
    "gains_at_readouts",
    "get_light",
    "group_gains",
    "list_lamps",
    "read_schedule",
    "split_schedule",
    "states_spectrum",
]
