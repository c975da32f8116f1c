"""Merging of shards that were made in separate folders, such as those of machines without a common disk."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from saf_gen.core.files import atomic_file, check_writable
from saf_gen.errors import BadInput
from saf_gen.generate.plan import check_same_dataset, stacks_of
from saf_gen.generate.record import has_recording
from saf_gen.generate.resolve import ResolvedRecipe, recipe_fingerprint
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.grain import FILE as GRAIN
from saf_gen.stack.grain import read_grain
from saf_gen.stream.manifest import MANIFEST_NAME


def gather_shards(
    resolved: ResolvedRecipe, folders: Sequence[Path], *, target: Path, tell: Callable[[str], None] = lambda line: None
) -> int:
    """Copy what shards have made into one folder, where ``generate`` then makes what is left, and return the bytes.

    Every picture is compared with its digest before it is copied. What the folder holds already stays, so an
    interrupted merge goes on where it was.

    Parameters
    ----------
    resolved : ResolvedRecipe
        The recipe of all shards.
    folders : sequence of Path
        Their folders, which remain as they are.
    target : Path
        Folder of the dataset; it may be one of ``folders``.
    tell : callable, optional
        Called with a line of text about stacks that two folders hold with different pictures.

    Raises
    ------
    BadInput
        If a folder is none of a shard of this recipe, or if ``target`` cannot be written to. Nothing is copied then.
    """
    for folder in folders:
        found = check_same_dataset(resolved, folder)
        if found is None:
            raise BadInput(f"has no {MANIFEST_NAME}", where=str(folder), allowed="a folder that a shard was made in")
        if found.recipe_fingerprint != recipe_fingerprint(resolved.recipe):
            raise BadInput("was made from another version of the recipe", where=str(folder))
    check_same_dataset(resolved, target)
    check_writable(target)
    sources = [folder for folder in folders if not (target.exists() and target.samefile(folder))]
    copied = 0
    for spec in stacks_of(resolved.sequences):
        copied += sum(_gather_stack(spec, source / "stacks", target=target / "stacks", tell=tell) for source in sources)
    for sequence in resolved.sequences:
        stack, file = sequence.time_stack, sequence.planned.file
        if not stack.has_all_notes(target / "stacks"):
            continue
        fingerprint = sequence.fingerprint(stack.digest(target / "stacks"))
        for source in sources:
            if not has_recording(target / file, fingerprint) and has_recording(source / file, fingerprint):
                copied += _copy(source / file, target / file)
    return copied


def _gather_stack(spec: StackSpec, source: Path, *, target: Path, tell: Callable[[str], None]) -> int:
    """Copy the pieces of a stack that the target lacks, and its grain; return their bytes."""
    there, here = StackStore(source, spec), StackStore(target, spec)
    if not there.folder.is_dir():
        return 0
    copied, missing = 0, here.missing_pieces()
    for piece in set(there.pieces) - set(there.missing_pieces()):
        if piece in missing:
            # The picture comes first, because a note without one says that it was made and deleted.
            copied += sum(
                _copy(there.folder / f"{piece}{end}", here.folder / f"{piece}{end}") for end in (".exr", ".json")
            )
        elif there.piece_digest(piece) != here.piece_digest(piece):
            tell(f"{there.folder} holds another {piece} than {here.folder}, which stays (of another renderer?)")
    if not there.has_all_pictures() and there.has_all_notes() and not here.folder.is_dir():
        copied += sum(_copy(there.folder / f"{piece}.json", here.folder / f"{piece}.json") for piece in there.pieces)
    if read_grain(target, spec) is None and read_grain(source, spec) is not None:
        copied += _copy(there.folder / GRAIN, here.folder / GRAIN)
    return copied


def _copy(source: Path, target: Path) -> int:
    with atomic_file(target) as part:
        shutil.copyfile(source, part)
    return target.stat().st_size
