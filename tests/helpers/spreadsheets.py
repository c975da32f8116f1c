"""Writes spreadsheets like those in SAF's folders, without a library."""

import zipfile

SHEET = (
    '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'
)
HEADING = ("id", "scene name", "frames", "focal frame", "dt", "path")


def write_xlsx(path, rows, *, shared=True, prolog=""):
    """Write a spreadsheet with shared texts, as Excel does, or with texts in the cells, as other programs do."""
    texts: list[str] = []

    def cell(text, name):
        if isinstance(text, int | float):
            return f'<c r="{name}"><v>{text}</v></c>'
        if not shared:
            return f'<c r="{name}" t="inlineStr"><is><t>{text}</t></is></c>'
        texts.append(text)
        return f'<c r="{name}" t="s"><v>{len(texts) - 1}</v></c>'

    lines = [
        f'<row r="{y}">{"".join(cell(t, "ABCDEF"[x] + str(y)) for x, t in enumerate(row) if t != "")}</row>'
        for y, row in enumerate(rows, start=1)
    ]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xl/worksheets/sheet1.xml", prolog + SHEET.format("".join(lines)))
        if shared:
            items = "".join(f"<si><t>{text}</t></si>" for text in texts)
            space = SHEET.split('"')[1]
            archive.writestr("xl/sharedStrings.xml", f'<sst xmlns="{space}">{items}</sst>')
