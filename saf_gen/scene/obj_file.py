"""OBJ meshes that count vertices from the end, which Mitsuba does not read: found, and rewritten.

In a face, -1 is the last vertex before it in the file, and so on for texture coordinates and normals.
"""

import re
from pathlib import Path

from saf_gen.errors import BadInput

NEGATIVE = re.compile(rb"^[ \t]*f[ \t][^\n]*?(?<![\w.+])-\d", re.MULTILINE)
KINDS = (b"v", b"vt", b"vn")


def counts_from_the_end(path: Path) -> bool:
    """Return whether a face of an OBJ mesh has a negative index."""
    return NEGATIVE.search(path.read_bytes()) is not None


def with_positive_indices(path: Path) -> bytes:
    """Return an OBJ mesh with all indices counted from 1; nothing else changes.

    Raises BadInput if an index is before the first vertex.
    """
    counts = dict.fromkeys(KINDS, 0)
    lines = path.read_bytes().split(b"\n")
    for n, line in enumerate(lines):
        words = line.split()
        if not words:
            continue
        if words[0] in counts:
            counts[words[0]] += 1
        elif words[0] == b"f":
            corners = [_positive(corner, counts, where=f"{path}:{n + 1}") for corner in words[1:]]
            lines[n] = b" ".join([b"f", *corners])
    return b"\n".join(lines)


def _positive(corner: bytes, counts: dict[bytes, int], *, where: str) -> bytes:
    parts = corner.split(b"/")
    for n, (part, kind) in enumerate(zip(parts, KINDS, strict=False)):
        if part.startswith(b"-") and part[1:].isdigit():
            index = counts[kind] + 1 + int(part)
            if index < 1:
                raise BadInput(
                    f"a face has the index {int(part)}, but there are {counts[kind]} before it",
                    where=where,
                    hint="export the mesh again",
                )
            parts[n] = b"%d" % index
    return b"/".join(parts)
