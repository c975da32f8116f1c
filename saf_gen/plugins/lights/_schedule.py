"""Light schedules: reading them from a recipe, and computing the gain of every readout.

A recipe gives one schedule for all light groups of a scene, or a schedule for each group by its name. A group without a
schedule keeps gain 1::

    {kind: flicker, depth: 0.3, offset: 0.5}
    {lamp: {kind: flash, at_s: 0.1, peak: 20}, ...}

Instead of one schedule there may be a list of several, whose lights add up. Each may state its ``spectrum``
(:mod:`saf_gen.core.spectrum`): two that cross are a lamp that changes from tungsten to LED. A list is the smallest
grammar for it, because everything that a lamp does over time is a schedule already::

    [{kind: ramp, from: 1, to: 0, spectrum: tungsten}, {kind: ramp, from: 0, to: 1, spectrum: led}]

A product multiplies schedules at each moment, for one lamp under several of them. Its factors are schedules by their
kind; what belongs to the whole lamp (``COMMON_KEYS``) stands beside the product, not in a factor::

    {product: [{kind: ramp, from: 1, to: 0.2}, {kind: flicker, depth: 0.3}], offset: 0.1}

A product is no factor itself, as the order and the grouping of factors change nothing. Instead of a light group, a key
may be a role, such as ``ambient``, and means all groups of the scene that have it (``ROLES``).

Every kind takes the keys of its class and those in ``COMMON_KEYS``. ``offset`` is constant light added to the schedule,
such as daylight in a room with a flickering lamp. With ``unit: lux``, all gains of the schedule and the offset are
illuminances of the target in lux. They are divided by ``lux_at_gain_1``, the illuminance of the target at gain 1, which
the scene card states.
"""

from collections.abc import Mapping
from itertools import product
from typing import Any

from saf_gen.core import seeds
from saf_gen.core.config import components, registry
from saf_gen.core.config.components import Component
from saf_gen.core.config.document import Document, Key
from saf_gen.core.config.ranges import draw_range, is_range, range_extremes
from saf_gen.core.csv_table import read_text_in
from saf_gen.errors import BadInput, located
from saf_gen.parts import Light
from saf_gen.plugins.lights._gains import COMMON_KEYS, get_light, list_factors, scale_light
from saf_gen.plugins.lights._groups import ROLES
from saf_gen.plugins.lights._lamps import PRODUCT, Schedule
from saf_gen.plugins.lights._product import multiply
from saf_gen.plugins.lights.constant import Constant


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
        return [_read(component, document, keys=(*keys, n)) for n, component in enumerate(schedule)]
    return _read(schedule, document, keys=keys)


def _read(component: Component, document: Document, *, keys: tuple[Key, ...]) -> Component:
    if isinstance(component, dict) and "spectrum" in component:
        where = document.locate(*keys, "spectrum")
        component = {**component, "spectrum": _with_table(component["spectrum"], document, where=where)}
    if isinstance(component, dict) and PRODUCT in component:
        return _read_product(component, document, keys=keys)
    if isinstance(component, dict) and component.get("kind") == PRODUCT and PRODUCT not in registry.names("lights"):
        raise BadInput("product is no kind", where=document.locate(*keys), allowed="{product: [{kind: ...}, ...]}")
    among = range_extremes(component, where=document.locate(*keys))
    if any(isinstance(one, dict) and PRODUCT in one for one in among):
        return {"choice": [_read(one, document, keys=keys) for one in among]}
    return components.read_component(
        "lights", component, document=document, keys=keys, common=COMMON_KEYS, build=_build_without_scene
    )


def _read_product(component: Component, document: Document, *, keys: tuple[Key, ...]) -> Component:
    """Check a product at every corner of each factor and of its own keys, and read the files that factors name."""
    with located(document.locate(*keys)):
        factors = list_factors(component)
    read = [
        components.read_component("lights", factor, document=document, keys=(*keys, PRODUCT, n), build=_build_as_factor)
        for n, factor in enumerate(factors)
    ]
    common = {key: value for key, value in component.items() if key != PRODUCT}
    corners = [range_extremes(value, where=document.locate(*keys, key)) for key, value in common.items()]
    for values in product(*corners):
        with located(document.locate(*keys)):
            scale_light(Constant(), **_with_lux(dict(zip(common, values, strict=True))))
    return {PRODUCT: read, **common}


def _build_as_factor(kind: str, /, **options: Any) -> Light:
    return multiply([get_light(kind, **options)])


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
    return get_light(kind, **_with_lux(options))


def _with_lux(options: dict[str, Any]) -> dict[str, Any]:
    return {"lux_at_gain_1": 1.0, **options} if options.get("unit") == "lux" else options


def split_schedule(schedule: dict[str, Any] | list[Any], *, where: str = "") -> dict[str, Schedule]:
    """Return a light schedule as {light group: component or list of them}; the key '' means all groups at once.

    Raises BadInput, located at ``where``, if a light group has no kind.
    """
    if isinstance(schedule, list) or _is_component(schedule):
        _check_list(schedule, where=where)
        return {"": schedule}
    for group, component in schedule.items():
        if isinstance(component, list):
            _check_list(component, where=where)
            continue
        if not isinstance(component, dict) or not _is_component(component):
            raise BadInput(
                f"light group {group!r} has no kind",
                where=where,
                allowed="{kind: ..., ...}, or {GROUP: {kind: ..., ...}, ...}",
                hint=f"choose one of the kinds {', '.join(registry.names('lights'))}",
            )
    return schedule


def _is_component(schedule: dict[str, Any]) -> bool:
    return "kind" in schedule or PRODUCT in schedule or is_range(schedule)


def _check_list(schedule: dict[str, Any] | list[Any], *, where: str) -> None:
    """Raise BadInput unless each entry of a list of schedules has a kind."""
    if isinstance(schedule, list) and not (
        schedule and all(isinstance(one, dict) and _is_component(one) for one in schedule)
    ):
        raise BadInput(
            f"a list of schedules is {schedule!r}",
            where=where,
            allowed="[{kind: ..., ...}, {kind: ..., ...}], whose lights add up",
        )


def draw_schedule(
    schedule: dict[str, Any] | list[Any],
    name: tuple[str | int, ...],
    *,
    illuminance_lux: Mapping[str, float],
    roles: Mapping[str, str] | None = None,
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
    roles : mapping of str to str, optional
        Role of each light group of the scene; if it is not given, a role is taken for the name of a group.

    Returns
    -------
    dict
        Component of each light group, or a list of them; the key '' means all groups at once. All groups of a role have
        one schedule, drawn once. A role that no group of the scene has is left out.

    Raises
    ------
    BadInput
        If a light group has a schedule by its name and another by its role, or if all schedules are those of roles that
        no group has.
    """
    groups_of = {key: groups_of_key(key, roles or {}) for key in split_schedule(schedule) if key}
    drawn: dict[str, Schedule] = {}
    for key, scheduled in split_schedule(schedule).items():
        groups = groups_of.get(key, tuple(illuminance_lux))
        lux = sum(illuminance_lux.get(group, 0.0) for group in groups)

        def draw(component: Component, *number: str, key: str = key, lux: float = lux) -> Component:
            one = _draw_component(component, name=name, purpose=("lights", key, *number))
            if lux and one.get("unit") == "lux":
                one.setdefault("lux_at_gain_1", lux)
            return one

        if isinstance(scheduled, list):
            one: Schedule = [draw(component, str(n)) for n, component in enumerate(scheduled)]
        else:
            one = draw(scheduled)
        for group in groups_of.get(key, ("",)):
            if group in drawn:
                other = next(before for before, groups in groups_of.items() if group in groups)
                raise BadInput(
                    f"the light group {group!r} has two schedules: that of {other} and that of {key}",
                    allowed="a schedule by the name of the group, or by its role",
                    hint="remove one of them; saf-gen scenes list shows groups and roles",
                )
            drawn[group] = one
    if groups_of and not drawn:
        raise BadInput(
            f"the scene has no light with the role {' or '.join(groups_of)}, so nothing would change",
            allowed=f"at least one of the roles {', '.join(dict.fromkeys((roles or {}).values()))}",
            hint="add a schedule for key, which every scene has, such as key: {kind: constant}",
        )
    return drawn


def groups_of_key(key: str, roles: Mapping[str, str]) -> tuple[str, ...]:
    """Return the light groups that a key of a schedule means: the group of this name, or all with this role.

    A key that is neither is returned as the name of a group, which :func:`group_gains` refuses.
    """
    if key in roles or key not in ROLES or not roles:
        return (key,)
    return tuple(group for group, role in roles.items() if role == key)


def _draw_component(component: Component, *, name: tuple[str | int, ...], purpose: tuple[str, ...]) -> Component:
    """Return a component with its open numbers drawn; each factor of a product has random streams of its own."""
    chosen = draw_range(component, seeds.make_generator(*name, "recipe", *purpose))
    if PRODUCT not in chosen:
        return components.draw_component("lights", component, name=name, purpose=purpose)
    drawn = {
        key: draw_range(value, seeds.make_generator(*name, "recipe", *purpose, key))
        for key, value in chosen.items()
        if key != PRODUCT
    }
    factors = [
        components.draw_component("lights", factor, name=name, purpose=(*purpose, PRODUCT, str(n)))
        for n, factor in enumerate(chosen[PRODUCT])
    ]
    return {PRODUCT: factors, **drawn}
