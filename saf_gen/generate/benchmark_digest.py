"""The digest of a benchmark: what a published recipe must keep, so that results under its name compare."""

import hashlib
import json

from saf_gen.core.config.frozen_benchmarks import read_frozen_benchmarks
from saf_gen.errors import BadInput
from saf_gen.generate.resolve import ResolvedRecipe


def digest_resolved_recipe(resolved: ResolvedRecipe) -> str:
    """Return the SHA-256 of all that decides the spikes of a recipe, in every split.

    Recipe, members and files of its scenes, sensor, and the versions of the models of lens, light and sensor enter. The
    renderer does not: LLVM and CUDA differ in the last digits of a picture (docs/explanation/one-pass.md).
    """
    decisive = [
        (s.fingerprint(""), [spec.key for spec in s.closed_loop_stack.specs] if s.closed_loop_stack else [])
        for s in resolved.plan
    ]
    return hashlib.sha256(json.dumps([resolved.recipe.name, decisive]).encode()).hexdigest()


def name_generated_benchmark(resolved: ResolvedRecipe) -> str:
    """Return the name and digest of the frozen benchmark that a recipe makes, as streams carry it; '' for any other.

    Raises BadInput for a recipe that has the name of a frozen benchmark and would give other spikes.
    """
    name = resolved.recipe.name
    frozen = read_frozen_benchmarks().get(name)
    if frozen is None:
        return ""
    digest = digest_resolved_recipe(resolved)
    if digest != frozen.digest:
        raise BadInput(
            f"the benchmark {name!r} is frozen, and this recipe would give other spikes: digest {digest:.12}…",
            allowed=f"{frozen.digest:.12}…, as on {frozen.since}",
            hint="give the recipe another name, or use the recipe and the scenes that come with saf_gen",
        )
    return f"{name} {digest}"
