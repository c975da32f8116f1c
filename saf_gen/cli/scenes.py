"""Commands on scenes: ``scenes list``."""

from rich.table import Table

from saf_gen.cli._terminal import out

__all__ = ["list_"]


def list_() -> None:
    """List the scenes that can be found."""
    from saf_gen.scene import find_scene, scene_names

    table = Table("scene", "title", "light groups", "lens", "licence")
    for name in scene_names():
        card = find_scene(name).card
        table.add_row(name, card.title, ", ".join(card.lights), card.lens.words, card.licence)
    out.print(table)
