"""Light schedules: the gain of each light group of a scene over the course of a recording.

Each kind of schedule is a file of this folder, or comes from a package with the entry point ``saf_gen.lights``.
"""

from saf_gen.plugins.lights._gains import COMMON_KEYS, UNITS, build_light, gains_at_readouts, get_light, group_gains
from saf_gen.plugins.lights._groups import RESERVED_GROUP_NAMES, ROLES, check_groups, default_roles
from saf_gen.plugins.lights._lamps import PRODUCT, Lamp, Schedule, list_lamps, states_spectrum
from saf_gen.plugins.lights._schedule import draw_schedule, groups_of_key, read_schedule, split_schedule

__all__ = [
    "COMMON_KEYS",
    "PRODUCT",
    "RESERVED_GROUP_NAMES",
    "ROLES",
    "UNITS",
    "Lamp",
    "Schedule",
    "build_light",
    "check_groups",
    "default_roles",
    "draw_schedule",
    "gains_at_readouts",
    "get_light",
    "group_gains",
    "groups_of_key",
    "list_lamps",
    "read_schedule",
    "split_schedule",
    "states_spectrum",
]
