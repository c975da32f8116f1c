"""Contact sheets of the focal stacks of a dataset, and (in ``scene_sheet``, which renders) of a scene being written."""

from saf_gen.authoring.preview.contact_sheet import ContactSheet, draw_preview_sheet, write_scene_preview
from saf_gen.authoring.preview.display_images import save_preview_image_grid

__all__ = ["ContactSheet", "draw_preview_sheet", "save_preview_image_grid", "write_scene_preview"]
