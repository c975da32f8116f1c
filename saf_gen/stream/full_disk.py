"""New HDF5 files on a disk that may become full."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py


class ErrorRecordingFile:
    """A new file to which HDF5 writes; ``error`` keeps the first error of the disk.

    If the disk is full, HDF5 can neither write nor discard its buffers, and prints a traceback for each of its objects
    that is freed. Therefore nothing more is written after an error, but every write still reports success to HDF5.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb+", buffering=0)
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        while left and self.error is None:
            try:
                left = left[self._file.write(left) :]
            except OSError as error:
                self.error = error
        return len(memoryview(data).cast("B"))

    def truncate(self, size: int) -> int:
        try:
            return self._file.truncate(size)
        except OSError as error:
            self.error = self.error or error
        return size

    def readinto(self, data: Any) -> int:
        """Read, with zeros for what was not written: HDF5 does not ask how much was read."""
        whole = memoryview(data).cast("B")
        count = self._file.readinto(whole) or 0
        whole[count:] = bytes(len(whole) - count)
        return len(whole)

    def read(self, size: int = -1) -> bytes:
        return self._file.read(size) or b""

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def flush(self) -> None:
        """Do nothing, because nothing is buffered."""

    def close(self) -> None:
        self._file.close()

    def check(self) -> None:
        """Raise the first error of the disk, if there was one."""
        if self.error is not None:
            raise self.error


@contextmanager
def new_hdf5(path: Path) -> Iterator[tuple[h5py.File, ErrorRecordingFile]]:
    """Yield a new HDF5 file, whose structures carry checksums, and the file below it, whose errors are to be checked.

    Raises OSError at the end if the disk was full, in place of any error that HDF5 made of it.
    """
    disk = ErrorRecordingFile(path)
    try:
        with h5py.File(disk, "w", libver="v110") as file:
            yield file, disk
        disk.check()
    except Exception:  # of any type: HDF5 fails in its own ways on what was not written
        disk.check()
        raise
    finally:
        disk.close()
