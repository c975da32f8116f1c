"""Triangles of an STL file, binary or text, shaded as planes.

References
----------
3D Systems, "StereoLithography Interface Specification", 1989.
"""

import re
from pathlib import Path

import numpy as np

from saf_gen.authoring.meshes.shapes import MAX_CORNERS, LeftOut, Shape, checked
from saf_gen.authoring.meshes.side_files import read_bytes
from saf_gen.errors import BadInput

HEADER, FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the triangles of an STL file, in its coordinates, as one shape without a name.

    Colours, which some programs store in the attribute of a facet, are added to ``left_out``.

    Raises BadInput if the file is damaged.
    """
    data = read_bytes(path)
    if len(data) >= HEADER and len(data) == HEADER + FACET.itemsize * int.from_bytes(data[80:84], "little"):
        facets = np.frombuffer(data, FACET, offset=HEADER)
        if facets["attribute"].any() or b"COLOR=" in data[:80]:
            left_out.add("colours of facets ignored")
        corners = facets["corners"].astype(np.float64).reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _text_corners(data, path)
    else:
        raise BadInput(
            f"the mesh is damaged: {len(data):,} bytes are neither text nor the number of facets that it states",
            where=str(path),
            hint="export or download it again",
        )
    if len(corners) > MAX_CORNERS:
        raise BadInput("the mesh is too large", where=str(path), allowed=f"up to {MAX_CORNERS // 3:,} triangles")
    if not len(corners):
        return []
    return [checked(Shape("", corners, np.arange(len(corners)).reshape(-1, 3), flat=True), left_out, path=path)]


def _text_corners(data: bytes, path: Path) -> np.ndarray:
    """Return the corners of all facets of a text file, float64 (corner, 3)."""
    words = data.lower().split()
    ends = len(re.findall(rb"\bendfacet\b", data, re.IGNORECASE))
    at = [n for n, word in enumerate(words) if word == b"vertex"]
    try:
        if b"endsolid" not in words or len(at) != 3 * ends:
            raise ValueError(f"it has {len(at)} vertices and {ends} complete facets")
        return np.array([[float(words[n + k]) for k in (1, 2, 3)] for n in at], dtype=np.float64).reshape(-1, 3)
    except (ValueError, IndexError) as error:
        raise BadInput(f"the mesh is damaged: {error}", where=str(path), hint="export or download it again") from error
