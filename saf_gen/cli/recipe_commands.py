"""The commands ``recipes list``, ``check`` and ``schema``."""

from typing import TYPE_CHECKING

from saf_gen.cli._tables import TableColumn, print_json, print_table
from saf_gen.cli._terminal import AsJson, OutFile, RecipeName, out

if TYPE_CHECKING:
    from saf_gen.generate.recipe import Recipe


def list_(*, as_json: AsJson = False) -> None:
    """List the recipes that come with saf_gen: ``saf-gen generate NAME`` makes one."""
    from saf_gen.core.shipped import find_recipe, recipe_names
    from saf_gen.generate.recipe import read_recipe

    recipes = [read_recipe(find_recipe(name)) for name in recipe_names()]
    columns = TableColumn("recipe"), TableColumn("frames", justify="right")
    print_table(
        [*columns, TableColumn("scenes by split", folds=True), TableColumn("lights", folds=True)],
        [(r.name, f"{r.camera.frames:,}", _format_splits(r), ", ".join(r.lights)) for r in recipes],
        as_json=as_json,
    )


def _format_splits(recipe: "Recipe") -> str:
    return "; ".join(f"{split}: {', '.join(settings.scenes)}" for split, settings in recipe.splits.items())


def check(recipe: RecipeName) -> None:
    """Check a recipe and the scenes, sensor and files that it names; nothing is generated."""
    from saf_gen.generate.coarse_sampling import find_coarse_sampling
    from saf_gen.generate.resolve import resolve_recipe

    work = resolve_recipe(recipe)
    for line in find_coarse_sampling(work):
        out.print(f"warning: {line}")
    out.print(f"{recipe} is fine: {len(work.sequences)} sequences of {', '.join(work.scenes)}")


def schema(*, path: OutFile = None) -> None:
    """Print the JSON Schema of recipes, with which an editor completes keys and marks mistakes."""
    from saf_gen.generate.recipe_schema import make_recipe_schema

    print_json(make_recipe_schema(), path)
