"""Damage to the heap in which HDF5 stores texts, which would make it look for one for ever."""

from pathlib import Path


def break_text_heap(path: Path, length: int) -> None:
    """Give the free space after the first heap's texts another ``length``, so that its pieces do not end with it."""
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    at, end = heap + 16, heap + int.from_bytes(content[heap + 8 : heap + 16], "little")
    while int.from_bytes(content[at : at + 2], "little"):  # 0 marks the free space
        at += 16 + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    assert at < end
    content[at + 8 : at + 16] = length.to_bytes(8, "little")
    path.write_bytes(content)
