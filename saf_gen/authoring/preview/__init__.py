"""Contact sheets: of a focal stack of a dataset, and of a scene that its author works on."""

from saf_gen.authoring.preview.contact_sheet import ContactSheet, draw_contact_sheet, write_preview
from saf_gen.authoring.preview.display_images import encode_gamma, save_image_grid, white_level
from saf_gen.authoring.preview.scene_sheet import make_contact_sheet, preview_scene, render_small_images

__all__ = [
    "ContactSheet",
    "draw_contact_sheet",
    "encode_gamma",
    "make_contact_sheet",
    "preview_scene",
    "render_small_images",
    "save_image_grid",
    "white_level",
    "write_preview",
]
