"""Import and export of the file layouts of other software."""

from saf_gen.stream.interop.array_files import ENDINGS as ARRAY_ENDINGS
from saf_gen.stream.interop.bad_pixels import read_mask
from saf_gen.stream.interop.lens_log import describe_coverage, import_lens_log, import_light_log, truth_from_text
from saf_gen.stream.interop.raw_frames import (
    RAW_LAYOUTS,
    READERS,
    RawFrames,
    RawLayout,
    count_raw_frames,
    export_raw_frames,
    find_layout,
    fitting_layouts,
    import_raw_frames,
    state_layout,
)
from saf_gen.stream.interop.readouts import Readouts, read_times
from saf_gen.stream.interop.source import Source, write_source
from saf_gen.stream.interop.spike_array import SpikeArray

__all__ = [
    "ARRAY_ENDINGS",
    "RAW_LAYOUTS",
    "READERS",
    "RawFrames",
    "RawLayout",
    "Readouts",
    "Source",
    "SpikeArray",
    "count_raw_frames",
    "describe_coverage",
    "export_raw_frames",
    "find_layout",
    "fitting_layouts",
    "import_lens_log",
    "import_light_log",
    "import_raw_frames",
    "read_mask",
    "read_times",
    "state_layout",
    "truth_from_text",
    "write_source",
]
