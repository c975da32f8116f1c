"""Roles that the lights of a recipe mean, and that some of its scenes lack."""

from collections.abc import Iterable, Mapping
from typing import Any

from saf_gen.generate.colours import Drawn
from saf_gen.plugins.lights import groups_of_key, split_schedule


def missing_roles(sequences: Iterable[Drawn], lights: Mapping[str, dict[str, Any] | list[Any]]) -> list[str]:
    """Return a line for each light and each role in it that some scenes lack, where its schedule is left out.

    Parameters
    ----------
    sequences : iterable of ResolvedSequence
        Sequences of the recipe.
    lights : mapping of str to dict or list
        Light schedules of the recipe by name.
    """
    lacking: dict[tuple[str, str], dict[str, None]] = {}
    for sequence in sequences:
        light, card = sequence.planned.light, sequence.scene.card
        for key in split_schedule(lights[light]):
            if key and not groups_of_key(key, card.light_roles):
                lacking.setdefault((light, key), {})[card.id] = None
    return [
        f"light {light!r}: {', '.join(scenes)} {'have' if len(scenes) > 1 else 'has'} no light with the role {role}, "
        "whose schedule is left out there; saf-gen scenes list shows groups and roles"
        for (light, role), scenes in lacking.items()
    ]
