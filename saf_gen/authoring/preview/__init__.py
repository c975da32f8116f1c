"""Contact sheets: of a focal stack of a dataset, and of a scene that its author works on."""

from saf_gen.authoring.preview.contact_sheet import ContactSheet, draw_contact_sheet, write_preview
from saf_gen.authoring.preview.display_images import save_preview_image_grid
from saf_gen.authoring.preview.scene_sheet import make_contact_sheet, preview_scene, render_small_images

__all__ = [
    "ContactSheet",
    "draw_contact_sheet",
    "make_contact_sheet",
    "preview_scene",
    "render_small_images",
    "save_preview_image_grid",
    "write_preview",
]
