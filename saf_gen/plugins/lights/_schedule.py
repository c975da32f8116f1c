"""Light schedules: reading them from a recipe, and computing the gain of every readout.

A recipe gives one schedule for all light groups of a scene, or a schedule for each group by its name. A group without a
schedule keeps gain 1::

    {kind: flicker, depth: 0.3, offset: 0.5}
    {lamp: {kind: flash, at_s: 0.1, peak: 20}, ...}

Instead of one schedule there may be a list of several, whose lights add up. Each may state its ``spectrum``
(:mod:`saf_gen.core.spectrum`): two that cross are a lamp that changes from tungsten to LED. A list is the smallest
grammar for it, because everything that a lamp does over time is a schedule already::

    [{kind: ramp, from: 1, to: 0, spectrum: tungsten}, {kind: ramp, from: 0, to: 1, spectrum: led}]

which is also written, and read as that list, as::

    {kind: constant, spectrum: {from: tungsten, to: led}}

Every kind takes the keys of its class and those in ``COMMON_KEYS``. ``offset`` is constant light added to the schedule,
such as daylight in a room with a flickering lamp. With ``unit: lux``, all gains of the schedule and the offset are
illuminances of the target in lux. They are divided by ``lux_at_gain_1``, the illuminance of the target at gain 1, which
the scene card states.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

import numpy as np

from saf_gen.core.config import components, registry
from saf_gen.core.config.components import Component
from saf_gen.core.config.document import Document, Key
from saf_gen.core.config.ranges import RANGE_FORMS, is_number, is_range
from saf_gen.core.csv_table import read_text_in
from saf_gen.core.spectrum import check_spectrum, describe
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.parts import Light

COMMON_KEYS = {
    "offset": "Gain, 0 or more (0): constant light of the same group, which is added to the schedule.",
    "unit": "ratio or lux (ratio): with lux, the gains and the offset are illuminances of the target in lux.",
    "lux_at_gain_1": "Lux, above 0 (from the scene card): with unit lux, the illuminance of the target at gain 1.",
    "spectrum": "led, tungsten, sodium, or one in braces (one wavelength, that of the sensor): the spectrum of the "
    "light; {blackbody: KELVINS}, {daylight: KELVINS}, or {file: TABLE.csv} with the columns wavelength_nm, power; of "
    "constant light also {from: SPECTRUM, to: SPECTRUM}, which changes from one to the other over the recording.",
}
"""Keys that every kind of light schedule takes in addition to the fields of its class, with their meaning."""

UNITS = ("ratio", "lux")
Schedule = Component | list[Component]
"""The schedule of a light group: one component, or several whose lights add up."""
GROUP = re.compile(r"[a-z0-9][a-z0-9_-]*")

RESERVED_GROUP_NAMES = frozenset({"geometry", "kind", *RANGE_FORMS})
"""Names that a light group cannot have, because files of a stack or keys of a schedule use them."""

GAIN_GRID = 2.0**-20
"""Gains are rounded to multiples of this step, so that spikes are the same on machines whose cosines differ in the last
digit."""


def check_groups(lights: Mapping[str, Sequence[str]], document: Document) -> None:
    """Check the light groups of a scene card.

    Parameters
    ----------
    lights : mapping of str to sequence of str
        Names of the emitters of each light group.
    document : Document
        The scene card, to locate errors.

    Raises
    ------
    BadInput
        If a name cannot name a file or cannot be used in a schedule, if a group has no emitters, or if an emitter is in
        two groups.
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


def read_schedule(
    schedule: dict[str, Any] | list[Any], document: Document, *, keys: tuple[str, ...]
) -> dict[str, Any] | list[Component]:
    """Check the light schedule at ``keys`` of a recipe, and return it with the text of the files that it names.

    Parameters
    ----------
    schedule : dict or list
        The schedule as written in the recipe, for all light groups or by light group.
    document : Document
        The recipe, to locate errors and files.
    keys : tuple of str
        Keys that lead to the schedule in the recipe.

    Returns
    -------
    dict or list
        The schedule, in the form in which it was given.

    Raises
    ------
    BadInput
        If the schedule is not valid; the error names file and line.
    """
    by_group = split_schedule(schedule, where=document.locate(*keys))
    if "" in by_group:
        return _read_all(by_group[""], document, keys=keys)
    return {group: _read_all(one, document, keys=(*keys, group)) for group, one in by_group.items()}


def _read_all(schedule: Schedule, document: Document, *, keys: tuple[Key, ...]) -> Schedule:
    if isinstance(schedule, list):
        read = [_read_crossing(component, document, keys=(*keys, n)) for n, component in enumerate(schedule)]
        return [component for components in read for component in components]
    first, *others = _read_crossing(schedule, document, keys=keys)
    return [first, *others] if others else first


def _read_crossing(component: Component, document: Document, *, keys: tuple[Key, ...]) -> list[Component]:
    """Read a component, which is two ramps if its spectrum changes from one to another."""
    spectrum = component.get("spectrum") if isinstance(component, dict) else None
    if not (isinstance(spectrum, dict) and {"from", "to"} & set(spectrum)):
        return [_read(component, document, keys=keys)]
    where, level = document.locate(*keys, "spectrum"), component.get("level", 1)
    if set(spectrum) != {"from", "to"}:
        raise BadInput(
            f"the spectrum has the keys {', '.join(map(str, spectrum))}",
            where=where,
            allowed="{from: SPECTRUM, to: SPECTRUM}, such as {from: tungsten, to: led}",
        )
    if component.get("kind") != "constant" or not is_number(level) or set(component) - {"kind", "level", "spectrum"}:
        raise BadInput(
            "a spectrum that changes is that of a light that does more than be constant",
            where=where,
            allowed="{kind: constant, spectrum: {from: …, to: …}}, and level as a number",
            hint="write two ramps that cross in a list: [{kind: ramp, from: 1, to: 0, spectrum: tungsten}, …]",
        )
    ramps = [
        {"kind": "ramp", "from": begin, "to": end, "spectrum": spectrum[key]}
        for key, begin, end in (("from", level, 0), ("to", 0, level))
    ]
    return [_read(ramp, document, keys=keys) for ramp in ramps]


def _read(component: Component, document: Document, *, keys: tuple[Key, ...]) -> Component:
    if isinstance(component, dict) and "spectrum" in component:
        where = document.locate(*keys, "spectrum")
        component = {**component, "spectrum": _with_table(component["spectrum"], document, where=where)}
    return components.read_component(
        "lights", component, document=document, keys=keys, common=COMMON_KEYS, build=_build_without_scene
    )


def _with_table(spectrum: Any, document: Document, *, where: str) -> Any:
    """Return a spectrum, or each of a choice, with the text of the table that it names."""
    if not isinstance(spectrum, dict):
        return spectrum
    if isinstance(spectrum.get("choice"), list):
        return {"choice": [_with_table(one, document, where=where) for one in spectrum["choice"]]}
    if isinstance(path := spectrum.get("file"), str):
        return {**spectrum, "file": {"path": path, "text": read_text_in(str(document.path.parent), path, where=where)}}
    return spectrum


def _build_without_scene(kind: str, /, **options: Any) -> Light:
    """Return a schedule whose scene, and therefore the illuminance at gain 1, is not known yet."""
    if options.get("unit") == "lux":
        options.setdefault("lux_at_gain_1", 1.0)
    return get_light(kind, **options)


def split_schedule(schedule: dict[str, Any] | list[Any], *, where: str = "") -> dict[str, Schedule]:
    """Return a light schedule as {light group: component or list of them}; the key '' means all groups at once.

    Raises BadInput, located at ``where``, if a light group has no kind.
    """
    if isinstance(schedule, list) or "kind" in schedule or is_range(schedule):
        _check_list(schedule, where=where)
        return {"": schedule}
    for group, component in schedule.items():
        if isinstance(component, list):
            _check_list(component, where=where)
            continue
        if not isinstance(component, dict) or not ("kind" in component or is_range(component)):
            raise BadInput(
                f"light group {group!r} has no kind",
                where=where,
                allowed="{kind: ..., ...}, or {GROUP: {kind: ..., ...}, ...}",
                hint=f"choose one of the kinds {', '.join(registry.names('lights'))}",
            )
    return schedule


def _check_list(schedule: dict[str, Any] | list[Any], *, where: str) -> None:
    """Raise BadInput unless each entry of a list of schedules has a kind."""
    if isinstance(schedule, list) and not (
        schedule and all(isinstance(one, dict) and ("kind" in one or is_range(one)) for one in schedule)
    ):
        raise BadInput(
            f"a list of schedules is {schedule!r}",
            where=where,
            allowed="[{kind: ..., ...}, {kind: ..., ...}], whose lights add up",
        )


def draw_schedule(
    schedule: dict[str, Any] | list[Any], name: tuple[str | int, ...], *, illuminance_lux: Mapping[str, float]
) -> dict[str, Schedule]:
    """Return the light schedule of one recording by light group, with all open numbers drawn.

    Parameters
    ----------
    schedule : dict or list
        The schedule as :func:`read_schedule` returns it.
    name : tuple of str or int
        Name of the random streams of the recording.
    illuminance_lux : mapping of str to float
        Illuminance of the target at gain 1 by light group, in lux, from the scene card.

    Returns
    -------
    dict
        Component of each light group, or a list of them; the key '' means all groups at once.
    """
    drawn: dict[str, Schedule] = {}
    for group, scheduled in split_schedule(schedule).items():
        lux = illuminance_lux.get(group) if group else sum(illuminance_lux.values())

        def draw(component: Component, *number: str, group: str = group, lux: float | None = lux) -> Component:
            one = components.draw_component("lights", component, name=name, purpose=("lights", group, *number))
            if lux and one.get("unit") == "lux":
                one.setdefault("lux_at_gain_1", lux)
            return one

        if isinstance(scheduled, list):
            drawn[group] = [draw(component, str(n)) for n, component in enumerate(scheduled)]
        else:
            drawn[group] = draw(scheduled)
    return drawn


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
    if "kind" in schedule:
        return schedule.get("spectrum") is not None
    return any(states_spectrum(one) for one in schedule.values() if isinstance(one, dict | list))


def get_light(
    name: str,
    /,
    *,
    offset: float = 0.0,
    unit: str = "ratio",
    lux_at_gain_1: float | None = None,
    spectrum: Any = None,
    **options: Any,
) -> Light:
    """Return a light schedule by its name.

    Parameters
    ----------
    name : str
        Kind of schedule: a file of ``saf_gen/plugins/lights``, a kind that another package offers,
        ``package.module:Class`` or ``file.py:Class``.
    offset : float, default 0
        Constant light added to the schedule, in ``unit``, 0 or more.
    unit : {"ratio", "lux"}, default "ratio"
        Unit of the schedule: gains, or illuminances of the target, which are divided by ``lux_at_gain_1``.
    lux_at_gain_1 : float, optional
        Illuminance of the target at gain 1 in lux, above 0; required if ``unit`` is "lux".
    spectrum : str or mapping, optional
        Spectrum of the light (:mod:`saf_gen.core.spectrum`). It is checked, and changes no gain: a gain is an
        illuminance.
    **options
        Fields of the schedule's class.

    Returns
    -------
    Light
        The schedule; gain 1 is the light as the scene defines it.

    Raises
    ------
    BadInput
        If the name or an option is unknown, or if a value is not allowed.
    """
    known = registry.option_fields("lights", name)
    for key in options:
        if key not in known:
            raise unknown(f"key of light schedule {name!r}:", key, allowed=(*known, *COMMON_KEYS))
    light: Light = registry.build_plugin("lights", name, **options)
    if spectrum is not None:
        check_spectrum(spectrum)
    if not (isinstance(offset, int | float) and 0 <= offset < inf):
        raise BadInput(f"offset is {offset!r}", allowed="0 or more, added to the gain")
    if unit not in UNITS:
        raise BadInput(f"unit is {unit!r}", allowed=", ".join(UNITS), nearest=closest(unit, UNITS))
    if unit == "lux" and lux_at_gain_1 is None:
        raise BadInput(
            "the schedule is in lux, but the illuminance at gain 1 is unknown",
            allowed="illuminance_lux on the scene's card, or lux_at_gain_1 in the schedule",
        )
    if unit == "ratio" and lux_at_gain_1 is not None:
        raise BadInput(f"lux_at_gain_1 is {lux_at_gain_1!r} in a schedule of ratios", hint="add unit: lux")
    unit_gain = 1.0 if lux_at_gain_1 is None else lux_at_gain_1
    if not (isinstance(unit_gain, int | float) and 0 < unit_gain < inf):
        raise BadInput(f"lux_at_gain_1 is {unit_gain!r}", allowed="lux, above 0")
    return light if offset == 0 and unit_gain == 1 else _ScaledLight(light, offset, unit_gain)


@dataclass(frozen=True)
class _ScaledLight:
    """The schedule (``light`` + ``offset``) / ``unit_gain``."""

    light: Light
    offset: float
    unit_gain: float

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        steady = self.offset * np.asarray(seconds, dtype=np.float64)
        return (self.light.integral(seconds, duration_s) + steady) / self.unit_gain


def gains_at_readouts(light: Light, frames: int, *, readout_hz: float) -> np.ndarray:
    """Return the mean gain of each readout.

    Gains are means over a readout instead of samples, as on a sensor that integrates: a lamp that flickers at 100 Hz
    gives the same sum in every window of 200 readouts at 20 kHz.

    Parameters
    ----------
    light : Light
        The schedule.
    frames : int
        Number of readouts.
    readout_hz : float
        Readouts per second.

    Returns
    -------
    ndarray of float32, shape (frames,)
        Gains, 0 or more, rounded to multiples of 2**-20.

    Raises
    ------
    BadInput
        If the gain falls below 0.
    """
    edges = np.arange(frames + 1) / readout_hz
    integral = registry.sample_function(light, light.integral, seconds=edges, duration_s=frames / readout_hz)
    gains = np.diff(integral) * readout_hz
    if not gains.min() >= -1e-9:
        raise BadInput(f"the gain of {light!r} falls to {gains.min():.3g}", allowed="gains of 0 or more")
    return (np.round(np.maximum(gains, 0) / GAIN_GRID) * GAIN_GRID).astype(np.float32)


def group_gains(
    schedule: Mapping[str, Schedule], groups: Sequence[str], *, frames: int, readout_hz: float
) -> np.ndarray:
    """Return the mean gain of each readout for each light group, or each lamp of :func:`list_lamps`.

    Parameters
    ----------
    schedule : mapping of str to mapping
        Components by light group, as :func:`draw_schedule` returns them. A group that is missing has gain 1.
    groups : sequence of str
        Light groups of the scene.
    frames : int
        Number of readouts.
    readout_hz : float
        Readouts per second.

    Returns
    -------
    ndarray of float32, shape (frames, L)
        Gains, 0 or more, of L lamps: one for each group, or as many as it has schedules.

    Raises
    ------
    BadInput
        If the schedule names a group that the scene does not have, if a gain falls below 0, or if float32 cannot hold
        a gain.
    """
    for name in schedule:
        if name and name not in groups:
            raise BadInput(f"the scene has no light group {name!r}", allowed=", ".join(groups))
    lamps = list_lamps(schedule, groups)
    gains = np.ones((frames, len(lamps)), dtype=np.float32)
    for g, (_, component, _) in enumerate(lamps):
        if component is not None:
            light = get_light(component["kind"], **{k: v for k, v in component.items() if k != "kind"})
            with np.errstate(over="ignore", invalid="ignore"):  # an overflow raises BadInput below
                gains[:, g] = gains_at_readouts(light, frames, readout_hz=readout_hz)
            if not np.isfinite(gains[:, g]).all():
                raise BadInput(
                    f"the gain of {light!r} is too large to be recorded",
                    allowed=f"gains up to {np.finfo(np.float32).max:.2g}",
                )
    return gains
