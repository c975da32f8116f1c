"""The commands ``recipes list`` and ``check``."""

from rich.table import Table

from saf_gen.cli._terminal import RecipeName, out


def list_() -> None:
    """List the recipes that come with saf_gen: ``saf-gen generate NAME`` makes one."""
    from saf_gen.core.shipped import find_recipe, recipe_names
    from saf_gen.generate.recipe import read_recipe

    table = Table("recipe", "frames", "scenes by split", "lights")
    for name in recipe_names():
        recipe = read_recipe(find_recipe(name))
        splits = "; ".join(f"{split}: {', '.join(settings.scenes)}" for split, settings in recipe.splits.items())
        table.add_row(name, f"{recipe.camera.frames:,}", splits, ", ".join(recipe.lights))
    out.print(table)


def check(recipe: RecipeName) -> None:
    """Check a recipe and the scenes, sensor and files that it names; nothing is generated."""
    from saf_gen.generate.resolve import resolve_recipe

    work = resolve_recipe(recipe)
    out.print(f"{recipe} is fine: {len(work.sequences)} sequences of {', '.join(work.scenes)}")
