"""Light groups of a scene card, and their roles."""

import re
from collections.abc import Iterable, Mapping, Sequence

from saf_gen.core.config.document import Document
from saf_gen.core.config.ranges import RANGE_FORMS
from saf_gen.errors import BadInput, unknown
from saf_gen.plugins.lights._lamps import PRODUCT

GROUP = re.compile(r"[a-z0-9][a-z0-9_-]*")
RESERVED_GROUP_NAMES = frozenset({"geometry", "kind", PRODUCT, *RANGE_FORMS})
"""Names that a light group cannot have, because files of a stack or keys of a schedule use them."""
ROLES = ("key", "fill", "ambient")
"""What a light group may be to its scene: the main light, a second light from elsewhere, the light from all around."""


def check_groups(lights: Mapping[str, Sequence[str]], document: Document, *, roles: Mapping[str, str]) -> None:
    """Check the light groups of a scene card.

    Parameters
    ----------
    lights : mapping of str to sequence of str
        Names of the emitters of each light group.
    document : Document
        The scene card, to locate errors.
    roles : mapping of str to str
        Role of each light group, as the card states it; empty if it states none.

    Raises
    ------
    BadInput
        If a name cannot name a file or cannot be used in a schedule, if a group has no emitters, if an emitter is in
        two groups, if some groups have a role and others none, if no group is the key, or if a group is called like a
        role that it does not have.
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
    if roles:
        _check_roles(lights, roles, document=document)


def _check_roles(lights: Mapping[str, Sequence[str]], roles: Mapping[str, str], *, document: Document) -> None:
    where = document.locate("roles")
    for group in roles:
        if group not in lights:
            raise unknown("light group of roles:", group, allowed=lights, where=document.locate("roles", group))
    if missing := [group for group in lights if group not in roles]:
        raise BadInput(
            f"the light group {missing[0]!r} has no role",
            where=where,
            allowed=f"a role for each of {', '.join(lights)}: {', '.join(ROLES)}; or no roles at all",
        )
    for group, role in roles.items():
        if group in ROLES and role != group:
            raise BadInput(
                f"the light group {group!r} has the role {role!r}",
                where=document.locate("roles", group),
                allowed=f"{group}, as its name says",
            )
    if "key" not in roles.values():
        raise BadInput(
            "no light group has the role 'key'", where=where, allowed="key for the main light of the scene, at least"
        )


def default_roles(lights: Iterable[str]) -> dict[str, str]:
    """Return the role of each light group of a card that states none, in the order of the card.

    A group that is called like a role has that role. Without a group ``key``, the first of the others is the key, or
    the first of all if there are no others; the rest is ambient.
    """
    roles = {group: group if group in ROLES else "ambient" for group in lights}
    if "key" not in roles.values():
        first = next((group for group in roles if group not in ROLES), next(iter(roles)))
        roles[first] = "key"
    return roles
