"""Contact sheets: of a focal stack of a dataset, and of a scene as its author has it."""

from saf_gen.preview.of_scene import glimpses, preview_scene, sheet_of
from saf_gen.preview.pictures import encoded, save_grid, white_of
from saf_gen.preview.sheet import Sheet, draw, write_preview

__all__ = [
    "Sheet",
    "draw",
    "encoded",
    "glimpses",
    "preview_scene",
    "save_grid",
    "sheet_of",
    "white_of",
    "write_preview",
]
