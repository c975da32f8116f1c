"""Files of events and of frames on a full disk: one line, nothing left behind, and no crash of HDF5 at the end."""

import re
import subprocess
import sys

import pytest

LIMITS = (100, 600, 3_000, 6_000, 20_000, 40_000, 60_000)
WRITE = {
    "frames": """
with FrameWriter(path, shape=(60, 40, 60), readout_hz=500, black_level_dn=240, metadata=metadata) as writer:
    for _ in range(60):
        writer.write(random.integers(0, 4096, (40, 60), np.uint16))
""",
    "events": """
n = 60_000
t = np.sort(random.integers(0, 190_000, n)).astype(np.uint32)
x, y, p = (random.integers(0, high, n).astype(kind) for high, kind in ((60, "u2"), (40, "u2"), (2, "u1")))
with EventWriter(path, shape=(4000, 40, 60), readout_hz=20_000, metadata=metadata) as writer:
    for part in np.array_split(np.arange(n), 5):
        writer.write(EventColumns(x[part], y[part], t[part], p[part]))
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(WRITE))
def test_a_full_disk_is_one_line_and_leaves_nothing(kind, tmp_path):
    """A limit on the size of files acts like a full disk, with another errno; from the first structures to the end.

    HDF5 reads into memory that holds anything, here 0xA5.
    """
    body = WRITE[kind].replace("\n", "\n        ")
    script = f"""
import resource, signal
import numpy as np
from saf_gen.errors import BadInput
from saf_gen.stream.event_file import EventColumns, EventWriter
from saf_gen.stream.frame_file import FrameWriter
from saf_gen.stream.full_disk import ErrorRecordingFile
from saf_gen.stream.metadata import Metadata, Truth
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
random, path, readinto = np.random.default_rng(0), {str(tmp_path / "a.h5")!r}, ErrorRecordingFile.readinto
def read_over_anything(disk, data):
    memoryview(data).cast("B")[:] = b"\\xa5" * len(data)
    return readinto(disk, data)
ErrorRecordingFile.readinto = read_over_anything
depth = random.random((40, 60), np.float32)
metadata = Metadata(truth=Truth(depth=depth), provenance={{str(n): "x" * 3000 for n in range(9)}})
for limit in {LIMITS}:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:{body}
    except BadInput as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    lines = rf"(.*a\.h5 cannot be written: File too large; choose another folder\n){{{len(LIMITS)}}}"
    assert re.fullmatch(lines, done.stdout), done.stdout
    assert done.stderr == ""
    assert not list(tmp_path.iterdir())
