"""The command ``recipes check``."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._terminal import out


def check(recipe: Annotated[Path, typer.Argument(help="Recipe file.")]) -> None:
    """Check a recipe and the scenes, sensor and files that it names; nothing is generated."""
    from saf_gen.generate.resolve import resolve_recipe

    work = resolve_recipe(recipe)
    out.print(f"{recipe} is fine: {len(work.sequences)} sequences of {', '.join(work.scenes)}")
