"""Light schedules: the gain of each light group of a scene over the course of a recording.

Each kind of schedule is a file of this folder, or comes from a package with the entry point ``saf_gen.lights``.
"""

from saf_gen.plugins.lights._schedule import (
    COMMON_KEYS,
    RESERVED_GROUP_NAMES,
    UNITS,
    check_light_groups,
    draw_light_schedule,
    get_light,
    light_gains_at_readouts,
    light_group_gains,
    read_light_schedule,
    split_schedule_by_light_group,
)

__all__ = [
    "COMMON_KEYS",
    "RESERVED_GROUP_NAMES",
    "UNITS",
    "check_light_groups",
    "draw_light_schedule",
    "get_light",
    "light_gains_at_readouts",
    "light_group_gains",
    "read_light_schedule",
    "split_schedule_by_light_group",
]
