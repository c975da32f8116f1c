"""The recipes that come with saf_gen, by name."""

from pathlib import Path

from saf_gen.core.shipped import shipped_folder
from saf_gen.errors import unknown


def recipe_names() -> list[str]:
    """Return the names of the recipes that come with saf_gen, sorted."""
    return sorted(path.stem for path in shipped_folder("recipes").glob("*.yaml"))


def find_recipe(recipe: str | Path) -> Path:
    """Return the file of a recipe, given by its name if it comes with saf_gen, and otherwise by its path.

    A file in the working directory must be given as a path, such as "./mine", so that a name means the same everywhere.
    Raises BadInput for an unknown name; a path is returned unchanged.
    """
    name = str(recipe)
    if Path(name).suffix or Path(name).name != name:
        return Path(recipe)
    if name not in recipe_names():
        raise unknown("recipe", name, allowed=recipe_names(), hint="or the path of a recipe file, such as ./mine.yaml")
    return shipped_folder("recipes") / f"{name}.yaml"
