"""The commands ``recipes list`` and ``recipes check``."""

from typing import TYPE_CHECKING

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import AsJson, RecipeName, out
from saf_gen.cli.command import Command, Panel
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Column, Table

if TYPE_CHECKING:
    from saf_gen.generate.recipe import Recipe


def list_recipes_command(*, as_json: AsJson = False) -> None:
    """List the recipes that come with saf_gen; ``saf-gen generate NAME`` makes the dataset of one."""
    from saf_gen.generate.recipe import find_recipe, read_recipe, recipe_names

    columns = [
        Column("recipe", "name"),
        Column("frames", "camera.frames", ",", kind="number"),
        Column("scenes by split", _format_splits, folds=True),
        Column("lights", "lights", ", ".join, folds=True),
    ]
    print_table(Table(columns, [read_recipe(find_recipe(name)) for name in recipe_names()]), as_json=as_json)


def _format_splits(recipe: "Recipe") -> str:
    return "; ".join(f"{split}: {', '.join(settings.scenes)}" for split, settings in recipe.splits.items())


def check_recipe_command(recipe: RecipeName) -> None:
    """Check a recipe and the scenes, sensor and files that it names, without generating anything."""
    from saf_gen.generate.resolve import coarse_sampling, recipe_digest, resolve_recipe

    work = resolve_recipe(recipe)
    for line in coarse_sampling(work):
        out.print(f"warning: {line}")
    digest = f"{recipe_digest(work):.12}{', a frozen benchmark' if work.benchmark else ''}"
    out.print(
        f"{recipe} is fine: {plural(len(work.sequences), 'sequence')} of {', '.join(work.scenes)}; digest {digest}"
    )


COMMANDS = {
    "recipes list": Command(list_recipes_command, ("recipes list",), Panel.GENERATE),
    "recipes check": Command(check_recipe_command, ("recipes check my_recipe.yaml",), Panel.GENERATE),
}
"""The commands of this file, by the words that call them."""
