"""Import and export of file layouts of other software."""

from saf_gen.stream.interop.raw_frames import RAW_LAYOUTS, export_raw_frames, import_raw_frames

__all__ = ["RAW_LAYOUTS", "export_raw_frames", "import_raw_frames"]
