"""Contact sheets of the focal stacks of a dataset, and (in ``scene_sheet``, which renders) of a scene being written."""

from saf_gen.authoring.preview.contact_sheet import ContactSheet, draw_sheet, write_preview
from saf_gen.authoring.preview.display_images import save_image_grid

__all__ = ["ContactSheet", "draw_sheet", "save_image_grid", "write_preview"]
