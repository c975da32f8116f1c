"""Whether a file is as long as its container states, for containers that state it in a few bytes."""

from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

EBML = b"\x1a\x45\xdf\xa3"
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""The first bytes of TIFF and BigTIFF, which say the order of bytes of all numbers."""
ASF_HEADER, ASF_FILE = (
    bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c"),
    bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365"),
)
BOXES = set(b"ftyp styp moov moof mdat mfra free skip wide pnot sidx ssix meta udta uuid emsg prft pdin bloc".split())
"""Boxes at the top of a file of ISO/IEC 14496-12 or QuickTime."""
TS_PACKETS, SYNC, NULL_PACKETS = ((188, 0), (192, 4), (204, 0)), 0x47, 0x1FFF
"""Length of the packets of MPEG transport streams with the place of their first byte; that byte; and a part of it."""


def find_cut(path: Path) -> str:
    """Return how a file falls short of what its container states, in words, or an empty text.

    Knows ISO media (MP4, MOV), Matroska and WebM, RIFF (AVI, WebP), ASF (WMV), MPEG transport streams, GIF and TIFF.
    All other files pass.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(64)
        if head[4:8] in BOXES:
            return _check_boxes(file, size)
        if head[:6] in (b"GIF87a", b"GIF89a"):
            return _check_gif(head + file.read())
        if head[:4] in TIFF:
            return _check_pages(file, size)
        if head.startswith(EBML):
            end = _segment_end(file, size)
        elif head.startswith(b"RIFF"):
            end = 8 + int.from_bytes(head[4:8], "little")
        elif head.startswith(ASF_HEADER):
            head += file.read(1 << 16)
            at = head.find(ASF_FILE) + 40  # the file properties object, section 3.2 of the specification
            end = int.from_bytes(head[at : at + 8], "little") if at >= 40 else 0
        else:
            return _check_packets(np.memmap(path, np.uint8, "r")) if SYNC in head[:5] else ""
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


def _check_pages(file: BinaryIO, size: int) -> str:
    """Go through the directories of a TIFF (revision 6.0, section 2), a list in which each page states the next."""
    file.seek(0)
    head = file.read(16)
    order: Literal["little", "big"] = "little" if head[:2] == b"II" else "big"
    is_big = b"+" in head[:4]
    count_bytes, entry_bytes, place_bytes = (8, 20, 8) if is_big else (2, 12, 4)
    at, seen = int.from_bytes(head[8:16] if is_big else head[4:8], order), set[int]()
    while at and at not in seen:
        seen.add(at)
        file.seek(at)
        entries = int.from_bytes(file.read(count_bytes), order)
        following = at + count_bytes + entries * entry_bytes
        if not entries or following + place_bytes > size:
            return f"page {len(seen)} is missing or cut off"
        file.seek(following)
        at = int.from_bytes(file.read(place_bytes), order)
    return ""


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


def _check_packets(data: np.ndarray) -> str:
    """Go through the packets of an MPEG transport stream (ISO/IEC 13818-1, 2.4.3), which count to 16 in each part."""
    for length, first in TS_PACKETS:
        if len(data) > 3 * length and (data[first : 4 * length : length] == SYNC).all():
            break
    else:
        return ""
    rest = (len(data) - first) % length
    packets = data[first : len(data) - rest].reshape(-1, length) if rest else data[first:].reshape(-1, length)
    lost = np.flatnonzero(packets[:, 0] != SYNC)
    if rest not in (0, length - first) or len(lost):
        return f"byte {int(lost[0]) * length if len(lost) else len(data) - rest} begins no whole packet"
    part = (packets[:, 1] & 0x1F).astype(int) << 8 | packets[:, 2]
    counter, has_payload = packets[:, 3] & 15, packets[:, 3] & 16 > 0
    told = (packets[:, 3] & 32 > 0) & (packets[:, 4] > 0) & (packets[:, 5] & 128 > 0)  # that counting begins again
    for number in np.unique(part):
        if number == NULL_PACKETS:
            continue
        here = np.flatnonzero((part == number) & has_payload)
        step = (counter[here[1:]] - counter[here[:-1]]) & 15
        gaps = np.flatnonzero((step > 1) & ~told[here[1:]])  # a packet may come twice
        if len(gaps):
            return f"packets are missing at byte {int(here[gaps[0] + 1]) * length}"
    return ""


def _check_gif(data: bytes) -> str:
    """Go through the blocks of a GIF up to its trailer."""
    at = 13 + (3 << (data[10] & 7) + 1 if len(data) > 10 and data[10] & 128 else 0)
    while at < len(data) and data[at] != 0x3B:
        if data[at] == 0x2C and at + 9 < len(data):  # an image, with its own colours and a byte for the code size
            at += 11 + (3 << (data[at + 9] & 7) + 1 if data[at + 9] & 128 else 0)
        elif data[at] == 0x21:
            at += 2
        else:
            return f"byte {at} begins no block of a GIF"
        while at < len(data) and data[at]:
            at += 1 + data[at]
        at += 1
    if at >= len(data):
        return "it has no end"
    return f"{len(data) - at - 1} bytes follow its end" if data[at + 1 :].strip(b"\0") else ""
