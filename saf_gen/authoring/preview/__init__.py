"""Contact sheets: of a focal stack of a dataset, and (in ``scene_sheet``, which renders) of a scene in the making."""

from saf_gen.authoring.preview.contact_sheet import ContactSheet, draw_contact_sheet, write_preview
from saf_gen.authoring.preview.display_images import save_preview_image_grid

__all__ = ["ContactSheet", "draw_contact_sheet", "save_preview_image_grid", "write_preview"]
