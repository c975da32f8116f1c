"""Pack the glyphs of a font that a scene needs into a small file, which ``typeface`` of the scenes' kit reads.

``python tools/pack_typeface.py FONT OUT.npz``: FONT is a .ttf, .otf or .woff under a licence that lets its converted
outlines be passed on, such as OFL-1.1; put the text of the licence beside OUT, and do not give OUT a reserved name.
Only this tool needs fontTools; scenes do not.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fontTools.pens.cu2quPen import Cu2QuPen
from fontTools.pens.recordingPen import DecomposingRecordingPen
from fontTools.ttLib import TTFont

CHARACTERS = [chr(code) for code in range(32, 127)] + list("ÄÖÜäöüßÉéèçñ°–—‘’“”„…·×£€§½¼•→\ufb01\ufb02")
CURVE_ERROR = 1.0  # of a cubic curve that becomes quadratic, in units of the font


def main(source: str, target: str) -> None:
    """Write the file, and print how many glyphs and pairs it has."""
    font = TTFont(source)
    names = {character: font.getBestCmap().get(ord(character)) for character in CHARACTERS}
    names = {character: name for character, name in names.items() if name}
    points, on_curve, ends, contours = [], [], [], []
    for name in names.values():
        shapes = outline(font.getGlyphSet(), name)
        contours.append(len(shapes))
        for shape in shapes:
            points += [point for point, _ in shape]
            on_curve += [on for _, on in shape]
            ends.append(len(points))
    kern = {(a, b): value for (a, b), value in kerning(font, names).items() if value}
    place = {character: k for k, character in enumerate(names)}
    heights = [font["OS/2"].sCapHeight, font["OS/2"].sxHeight, font["hhea"].ascent, font["hhea"].descent]
    np.savez_compressed(
        target,
        em=np.int32(font["head"].unitsPerEm),
        heights=np.array(heights, dtype=np.int16),
        characters=np.array([ord(character) for character in names], dtype=np.uint16),
        advances=np.array([font["hmtx"][name][0] for name in names.values()], dtype=np.int16),
        points=np.round(points).astype(np.int16),
        on_curve=np.array(on_curve, dtype=bool),
        ends=np.array(ends, dtype=np.int32),
        contours=np.array(contours, dtype=np.uint8),
        left=np.array([place[a] for a, _ in kern], dtype=np.uint8),
        right=np.array([place[b] for _, b in kern], dtype=np.uint8),
        kern=np.array(list(kern.values()), dtype=np.int16),
    )
    print(
        f"{target}: {len(names)} glyphs, {len(points)} points, {len(kern)} pairs, {Path(target).stat().st_size} bytes"
    )


def outline(glyphs: Any, name: str) -> list[list[tuple[tuple[float, float], bool]]]:
    """Return the contours of a glyph as points with whether each lies on the curve, never two off it in a row."""
    recorded = DecomposingRecordingPen(glyphs)
    glyphs[name].draw(Cu2QuPen(recorded, CURVE_ERROR))
    shapes: list[list[tuple[tuple[float, float], bool]]] = []
    for step, values in recorded.value:
        if step == "moveTo":
            shapes.append([(values[0], True)])
        elif step == "lineTo":
            shapes[-1].append((values[0], True))
        elif step == "qCurveTo":
            if values[-1] is None:  # a closed contour without a point on the curve
                values = (*values[:-1], middle(values[-2], values[0]))
                shapes.append([(values[-1], True)])
            *controls, last = values
            for k, control in enumerate(controls):
                shapes[-1].append((control, False))
                shapes[-1].append((middle(control, controls[k + 1]) if k + 1 < len(controls) else last, True))
    for shape in shapes:
        if shape[0] == shape[-1]:
            shape.pop()  # the contour closes by itself
    return [shape for shape in shapes if len(shape) > 2]


def middle(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Return the point half-way between two."""
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2


def kerning(font: TTFont, names: dict[str, str]) -> dict[tuple[str, str], int]:
    """Return the change of distance of each pair of characters, in units of the font; the first lookup that has it."""
    found: dict[tuple[str, str], int] = {}
    for table in pair_tables(font):
        covered = set(table.Coverage.glyphs)
        firsts = {character: name for character, name in names.items() if name in covered}
        if table.Format == 1:
            sets = dict(zip(table.Coverage.glyphs, table.PairSet, strict=True))
            for a, first in firsts.items():
                values = {record.SecondGlyph: record.Value1 for record in sets[first].PairValueRecord}
                for b, second in names.items():
                    if second in values:
                        found.setdefault((a, b), getattr(values[second], "XAdvance", 0) or 0)
        else:
            for a, first in firsts.items():
                row = table.Class1Record[table.ClassDef1.classDefs.get(first, 0)].Class2Record
                for b, second in names.items():
                    value = row[table.ClassDef2.classDefs.get(second, 0)].Value1
                    amount = getattr(value, "XAdvance", 0) or 0
                    if amount or second in table.ClassDef2.classDefs:
                        found.setdefault((a, b), amount)
    return found


def pair_tables(font: TTFont) -> Iterator[Any]:
    """Yield the subtables of pairs that the feature ``kern`` names, in the order of the font."""
    if "GPOS" not in font:
        return
    layout = font["GPOS"].table
    wanted = {
        index
        for record in layout.FeatureList.FeatureRecord
        if record.FeatureTag == "kern"
        for index in record.Feature.LookupListIndex
    }
    for index in sorted(wanted):
        for table in layout.LookupList.Lookup[index].SubTable:
            table = getattr(table, "ExtSubTable", table)
            if table.LookupType == 2:
                yield table


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python tools/pack_typeface.py FONT OUT.npz")
    main(*sys.argv[1:])
