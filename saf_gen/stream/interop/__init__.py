"""Foreign file layouts, one file a family: in and out of the stream file."""

from saf_gen.stream.interop.raw_frames import RAW_LAYOUTS, export_raw_frames, import_raw_frames

__all__ = ["RAW_LAYOUTS", "export_raw_frames", "import_raw_frames"]
