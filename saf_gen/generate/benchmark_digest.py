"""The digest of a frozen benchmark, which its recipe must keep so that results under its name can be compared."""

import hashlib
import json

from saf_gen.core.config.frozen_benchmarks import read_frozen_digests
from saf_gen.errors import BadInput
from saf_gen.generate.resolve import ResolvedRecipe


def recipe_digest(resolved: ResolvedRecipe) -> str:
    """Return the SHA-256 of everything that determines the spikes of a recipe, in every split.

    It covers the recipe, the members and files of its scenes, the sensor, and the versions of the models of lens, light
    and sensor. It does not cover the renderer, because LLVM and CUDA differ in the last digits of a picture
    (docs/explanation/renderer.md#one-pass).
    """
    decisive = [
        (s.fingerprint(""), [spec.key for spec in s.closed_loop_stack.specs] if s.closed_loop_stack else [])
        for s in resolved.plan
    ]
    return hashlib.sha256(json.dumps([resolved.recipe.name, decisive]).encode()).hexdigest()


def benchmark_name(resolved: ResolvedRecipe) -> str:
    """Return the name and digest of a recipe's frozen benchmark, as streams store them; '' if it has no such benchmark.

    Raises BadInput if the recipe has the name of a frozen benchmark but would give different spikes.
    """
    name = resolved.recipe.name
    frozen = read_frozen_digests().get(name)
    if frozen is None:
        return ""
    digest = recipe_digest(resolved)
    if digest != frozen.digest:
        raise BadInput(
            f"the benchmark {name!r} is frozen, but this recipe would give different spikes: digest {digest:.12}…",
            allowed=f"{frozen.digest:.12}…, as on {frozen.since}",
            hint="give the recipe another name, or use the recipe and the scenes that come with saf_gen",
        )
    return f"{name} {digest}"
