"""The commands ``init`` and ``doctor``."""

import os
from pathlib import Path
from typing import Annotated

import typer

import saf_gen
from saf_gen.cli._tables import print_facts, print_json
from saf_gen.cli._terminal import AsJson, out


def init_command(
    folder: Annotated[Path, typer.Argument(help="Folder to work in, which is created if it is missing.")] = Path(),
    *,
    forget: Annotated[bool, typer.Option("--forget", help="Stop trusting the folder; no file is removed.")] = False,
) -> None:
    """Register a folder to work in: its scenes are found by name there, and their code is trusted.

    A scene of the folder then replaces one of the same name that comes with saf_gen. Until the folder is registered,
    no script in its scenes/ runs, so read scripts that others sent you first. The folder also gets the JSON Schemas of
    recipes and scene cards, with which editors complete keys and mark mistakes.
    """
    from saf_gen.core.files import unwritable
    from saf_gen.generate.recipe import recipe_schema
    from saf_gen.scene.card_schema import card_schema
    from saf_gen.scene.scene_folder import CARD_FILE
    from saf_gen.scene.trusted_folders import forget_folder, register_folder

    scenes = folder / "scenes"
    shown = scenes.resolve()
    if forget:
        was_registered = forget_folder(scenes)
        out.print(
            f"{shown} is {'no longer' if was_registered else 'not'} registered; its files are unchanged", soft_wrap=True
        )
        return
    try:
        scenes.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(scenes, error) from error
    is_new = register_folder(scenes)
    if os.access(folder, os.W_OK):  # others may share a folder that only its owner changes
        print_json(recipe_schema(), folder / "recipe.schema.json")
        print_json(card_schema(), folder / "scene.schema.json")
    out.print(f"{shown} {'is' if is_new else 'was'} registered{'' if is_new else ' already'}", soft_wrap=True)
    if scene_names := sorted(card.parent.name for card in scenes.glob(f"*/{CARD_FILE}")):
        out.print(f"scenes found by name in {folder.resolve()}: {', '.join(scene_names)}", soft_wrap=True)
    out.print("next: saf-gen scenes new my_scene; saf-gen generate quickstart")


def doctor_command(*, as_json: AsJson = False) -> None:
    """Show the renderer, hardware and versions of this machine, and check in some seconds that it computes correctly.

    The blur of an edge and the intervals of spikes are compared with their laws, and spikes with those of other
    machines. The exit code is 1 if one of them differs.
    """
    from saf_gen.cli.doctor import describe_machine, self_check

    described, advice = describe_machine()
    if not as_json:
        print_facts(described, title=f"saf-gen {saf_gen.__version__}")
        for line in advice:
            out.print(line)
    checked = {name: f"{'ok' if passed else 'failed'}: {said}" for name, (passed, said) in self_check().items()}
    if as_json:
        print_json(described | checked)
    else:
        for name, text in checked.items():
            out.print(f"{text.partition(': ')[0]}: {name}: {text.partition(': ')[2]}", soft_wrap=True)
    if any(text.startswith("failed") for text in checked.values()):
        raise typer.Exit(1)
