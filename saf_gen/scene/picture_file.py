"""Formats of pictures that Mitsuba reads, told by the first bytes of a file, whatever its name."""

from pathlib import Path

from saf_gen.errors import BadInput

ALLOWED = "PNG, JPEG, BMP, TGA, PPM, PFM, HDR, OpenEXR"
READ = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"BM": "BMP",
    b"\x76\x2f\x31\x01": "OpenEXR",
    b"#?": "HDR",
    **{b"P%d" % n: "PPM" for n in range(2, 7)},
    b"PF": "PFM",
    b"Pf": "PFM",
}
NOT_READ = {
    b"II*\0": "a TIFF file",
    b"MM\0*": "a TIFF file",
    b"II+\0": "a BigTIFF file",
    b"MM\0+": "a BigTIFF file",
    b"GIF8": "a GIF file",
    b"DDS ": "a DDS file",
    b"\xabKTX": "a KTX file",
    b"8BPS": "a Photoshop file",
    b"\0\0\0\x0cjP": "a JPEG 2000 file",
    b"\xff\x4f\xff\x51": "a JPEG 2000 file",
    b"SIMPLE": "a FITS file",
    b"%PDF": "a PDF file",
    b"<svg": "an SVG file",
    b"<?xml": "an XML or SVG file",
    b"version https://git-lfs": "a pointer of Git LFS",
}


def validate_picture(path: Path, *, where: str) -> None:
    """Raise BadInput, for the element at ``where``, unless a file begins like a picture that Mitsuba reads."""
    with path.open("rb") as file:
        head = file.read(64)
    if any(head.startswith(magic) for magic in READ):
        return
    if path.suffix.lower() == ".tga" and len(head) >= 18 and head[1] in (0, 1) and head[2] in (1, 2, 3, 9, 10, 11):
        return  # TGA has no mark
    kind = next((name for magic, name in NOT_READ.items() if head.startswith(magic)), "")
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        kind = "a WebP file"
    if head[4:8] == b"ftyp":
        kind = "an AVIF or HEIF file"
    if not head:
        kind = "empty"
    raise BadInput(
        f"the picture {path.name!r} is {kind or 'of an unknown format'}",
        where=where,
        allowed=ALLOWED,
        hint="save it as PNG, or as OpenEXR if it has more than 16 bits or no sRGB values, and name that file here",
    )
