"""The lamps of a recording: its light groups, each under one schedule or several."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from saf_gen.core.config.components import Component
from saf_gen.core.spectrum import describe

PRODUCT = "product"
"""Key of a component that is the product of schedules, in place of a kind."""
Schedule = Component | list[Component]
"""The schedule of a light group: one component, or several whose lights add up."""


class Lamp(NamedTuple):
    """One light of a recording: a light group under one of its schedules.

    Attributes
    ----------
    group : str
        Name of the light group.
    component : dict or None
        Its schedule; None for a group that stays at gain 1.
    name : str
        Name of the group, and the spectrum if it has several schedules.
    """

    group: str
    component: Component | None
    name: str

    @property
    def spectrum(self) -> Any:
        """The spectrum of the lamp as its schedule states it, or None."""
        return None if self.component is None else self.component.get("spectrum")


def list_lamps(schedule: Mapping[str, Schedule], groups: Sequence[str]) -> list[Lamp]:
    """Return the lights of a recording in order, one for each light group, or as many as a group has schedules.

    Parameters
    ----------
    schedule : mapping
        Schedules by light group, as :func:`draw_schedule` returns them.
    groups : sequence of str
        Light groups of the scene.
    """
    lamps = []
    for group in groups:
        scheduled = schedule.get("", schedule.get(group))
        if not isinstance(scheduled, list):
            lamps.append(Lamp(group, scheduled, group))
            continue
        for n, component in enumerate(scheduled):
            spectrum = component.get("spectrum")
            lamps.append(Lamp(group, component, f"{group} {n + 1}" + (f" ({describe(spectrum)})" if spectrum else "")))
    return lamps


def states_spectrum(schedule: Schedule | Mapping[str, Any]) -> bool:
    """Return whether any part of a schedule, as a recipe holds it, states a spectrum."""
    if isinstance(schedule, list):
        return any(map(states_spectrum, schedule))
    if "kind" in schedule or PRODUCT in schedule:
        return schedule.get("spectrum") is not None
    return any(states_spectrum(one) for one in schedule.values() if isinstance(one, dict | list))
