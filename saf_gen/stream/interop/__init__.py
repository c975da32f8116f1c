"""Import and export of the file layouts of other software."""

from saf_gen.stream.interop.array_files import ENDINGS as ARRAY_ENDINGS
from saf_gen.stream.interop.array_files import SpikeArray
from saf_gen.stream.interop.lens_log import import_lens_log, import_light_log, truth_from_text
from saf_gen.stream.interop.raw_frames import (
    RAW_LAYOUTS,
    READERS,
    count_raw_frames,
    export_raw_frames,
    import_raw_frames,
    sniff_layout,
)

__all__ = [
    "ARRAY_ENDINGS",
    "RAW_LAYOUTS",
    "READERS",
    "SpikeArray",
    "count_raw_frames",
    "export_raw_frames",
    "import_lens_log",
    "import_light_log",
    "import_raw_frames",
    "sniff_layout",
    "truth_from_text",
]
