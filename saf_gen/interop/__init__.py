"""Foreign file layouts, one file a family: in and out of the stream file."""

from saf_gen.interop.raw_frames import LAYOUTS, export_file, import_file

__all__ = ["LAYOUTS", "export_file", "import_file"]
