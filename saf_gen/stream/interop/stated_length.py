"""Whether a file is as long as its container states, for containers that state it in a few bytes."""

from pathlib import Path
from typing import BinaryIO

EBML = b"\x1a\x45\xdf\xa3"
BOXES = set(b"ftyp styp moov moof mdat mfra free skip wide pnot sidx ssix meta udta uuid emsg prft pdin bloc".split())
"""Boxes at the top of a file of ISO/IEC 14496-12 or QuickTime."""


def find_cut(path: Path) -> str:
    """Return how a file falls short of what its container states, in words, or an empty text.

    Knows ISO media (MP4, MOV), Matroska and WebM, and RIFF (AVI, WebP). All other files pass.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(64)
        if head[4:8] in BOXES:
            return _check_boxes(file, size)
        if head.startswith(EBML):
            end = _segment_end(file, size)
        elif head.startswith(b"RIFF"):
            end = 8 + int.from_bytes(head[4:8], "little")
        else:
            return ""
    return f"at least {end - size} bytes are missing" if end > size else ""


def _check_boxes(file: BinaryIO, size: int) -> str:
    """Go through the boxes of ISO/IEC 14496-12; the last one may reach to the end of the file."""
    at = 0
    while at < size:
        file.seek(at)
        head = file.read(16)
        length = int.from_bytes(head[8:16] if head[:4] == b"\0\0\0\1" else head[:4])
        if head[4:8] not in BOXES and any(head):
            return f"byte {at} begins no part of an MP4 or MOV file"
        if length == 0:
            return ""
        at += max(length, 8)
    return f"at least {at - size} bytes are missing" if at > size else ""


def _segment_end(file: BinaryIO, size: int) -> int:
    """Return where the last element at the top of a Matroska file ends (RFC 8794); a live recording leaves it open."""
    at = 0
    while at < size:
        file.seek(at)
        head = file.read(16)
        name = 9 - head[0].bit_length()
        width = 9 - head[name : name + 1].ljust(1, b"\0")[0].bit_length()
        digits = head[name : name + width]
        length, largest = int.from_bytes(digits) & ((1 << 7 * width) - 1), (1 << 7 * width) - 1
        if max(name, width) > 8 or len(digits) < width or length == largest:
            return 0
        at += name + width + length
    return at
