"""Whether all pictures of a scene show the same scene, by the sums of what its script returned for each of them.

The note of every rendered piece holds these sums (:mod:`saf_gen.render.scene_sums`). A script that gives something else
the next time, as by random numbers without a seed, would otherwise make one recording of two scenes.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

from saf_gen.errors import BadInput
from saf_gen.stack.focal_stack import StackSpec, StackStore

TOLERANCE = 1e-5
"""Largest difference of sums of up to MANY values and texts; of more, it grows with the root of their number."""
MANY = 1000
HINT = "seed random numbers, sort sets and lists of files, and avoid hash() of a text, which differs in each process"


def is_same(sums: Sequence[float], others: Sequence[float]) -> bool:
    """Return whether two calls of a script returned the same, by the sums of both."""
    if len(sums) != len(others) or sums[0] != others[0]:
        return False
    allowed = TOLERANCE * max(1.0, sums[0] / MANY) ** 0.5
    return all(abs(one - other) <= allowed for one, other in zip(sums, others, strict=True))


def require_same_scene(root: Path, specs: Iterable[StackSpec], *, sums: Sequence[float] = ()) -> None:
    """Raise BadInput if stored pictures of a scene were rendered from different results of its script.

    Parameters
    ----------
    root : Path
        Folder of the stacks.
    specs : iterable of StackSpec
        Stacks of one scene; those with other parameters than the first do not count, nor do pictures that are missing
        along with their notes.
    sums : sequence of float, optional
        Sums of what the script returned now, with which the stored ones are compared; by default, they are compared
        with each other.
    """
    first: StackSpec | None = None
    for spec in specs:
        first = first or spec
        if (spec.scene, spec.scene_digest, spec.params) != (first.scene, first.scene_digest, first.params):
            continue
        for stored in StackStore(root, spec).scene_sums():
            sums = sums or stored
            if not is_same(sums, stored):
                raise BadInput(
                    f"scene {spec.scene!r} is not the same twice: for pictures in {root / spec.key} its script "
                    "returned something else",
                    hint=HINT,
                )
