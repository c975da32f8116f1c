"""The commands ``recipes list``, ``check``, ``seal`` and ``unseal``."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import AsJson, RecipeName, out
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


def seal_command(
    recipe: Annotated[Path, typer.Argument(help="A recipe file.")],
    *,
    path: Annotated[Path | None, typer.Option("--out", help="File to write (default: RECIPE-sealed.yaml).")] = None,
    secret: Annotated[Path | None, typer.Option(help="File for the secret (default: RECIPE.secret).")] = None,
) -> None:
    """Hide the seed of a recipe, to publish the sealed recipe before submissions and the secret after them."""
    from saf_gen.generate.recipe import read_recipe
    from saf_gen.generate.sealing import seal_recipe

    read_recipe(recipe)
    sealed = path or recipe.with_stem(f"{recipe.stem}-sealed")
    secret_path = secret or recipe.with_suffix(".secret")
    seed = seal_recipe(recipe, sealed, secret_file=secret_path)
    out.print(f"{sealed}   (publish it: it commits to {seed.sealed})", soft_wrap=True)
    out.print(
        f"{secret_path}   (the secret, which determines a new seed: show it to nobody, and do not lose it)",
        soft_wrap=True,
    )


def unseal_command(
    recipe: Annotated[Path, typer.Argument(help="A sealed recipe file.")],
    secret: Annotated[str, typer.Option(help="The secret, 64 hexadecimal digits, or the file that holds it.")],
    *,
    path: Annotated[Path | None, typer.Option("--out", help="File to write (default: RECIPE-open.yaml).")] = None,
) -> None:
    """Open a sealed recipe with its secret, which must be the one that the recipe commits to."""
    from saf_gen.core.config.document import read_text
    from saf_gen.generate.recipe import read_recipe
    from saf_gen.generate.sealing import unseal_recipe

    text = read_text(Path(secret), max_bytes=4096) if Path(secret).is_file() else secret
    opened = path or recipe.with_stem(f"{recipe.stem.removesuffix('-sealed')}-open")
    unseal_recipe(recipe, opened, secret=text.strip())
    out.print(
        f"{opened}: seed {read_recipe(opened).seed}   (next: saf-gen generate {shlex.quote(str(opened))})",
        soft_wrap=True,
    )
