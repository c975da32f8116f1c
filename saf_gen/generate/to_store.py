"""Generation of a dataset in an object store, through a scratch folder on this machine that stays small.

The dataset is made in batches of complete focal stacks and the recordings made from them. While a batch is made, the
previous one is uploaded: first its stacks, then its streams; each file is checked on arrival. The batch is then
deleted here, and the manifest that lists it is written. A manifest therefore never lists incomplete files, and a run
that was killed continues from what is in the store and in the scratch folder.
"""

import hashlib
import shutil
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from urllib.parse import quote

from saf_gen.core.execution import Cluster, ReportProgress
from saf_gen.core.files import check_writable
from saf_gen.core.object_store import StorePath
from saf_gen.core.object_transfers import abort_uploads, check_store, list_objects
from saf_gen.generate.cost import bytes_of_stacks, bytes_of_streams
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence
from saf_gen.generate.run import GenerationResult, check_same_dataset, choose_renderer, generate
from saf_gen.generate.store_transfer import StoreTransfer, picture_names, stacks_of
from saf_gen.stack.focal_stack import StackSpec

BATCH_BYTES = 8_000_000_000
"""Approximate size of the stacks and streams of a batch; a stack that is larger with its streams is a batch alone."""


@dataclass(frozen=True)
class StorePlan:
    """The work of a run that makes a dataset in a store.

    Attributes
    ----------
    scratch : Path
        Scratch folder on this machine.
    in_store : frozenset of str
        Ids of the sequences that the store holds, judged by the names of its objects.
    missing : ResolvedRecipe
        The recipe, with only the sequences that the store lacks.
    stacks : list of str
        Labels of the stacks to render.
    upload_bytes, scratch_bytes : int
        Approximate numbers of bytes to upload, and of bytes in the scratch folder when it is fullest.
    """

    scratch: Path
    in_store: frozenset[str]
    missing: ResolvedRecipe
    stacks: list[str]
    upload_bytes: int
    scratch_bytes: int


def plan_for_store(resolved: ResolvedRecipe, store: StorePath) -> StorePlan:
    """Return the work of a run, without writing anything in the store or here.

    Raises BadInput if the store cannot be queried, or holds another dataset.
    """
    check_same_dataset(resolved, store)
    objects = list_objects(store)
    in_store = frozenset(s.planned.id for s in resolved.sequences if s.planned.file in objects)
    missing = [s for s in resolved.sequences if s.planned.id not in in_store]
    users = {stack: s for s in reversed(missing) for stack in (s.closed_loop_slices, s.time_stack) if stack}
    labels = [user.stack_label(stack) for stack, user in users.items() if not picture_names(stack.specs) <= objects]
    sizes = [_count_bytes(batch) for batch in split_into_batches(missing)]
    return StorePlan(
        scratch=find_scratch(resolved, store),
        in_store=in_store,
        missing=replace(resolved, sequences=tuple(missing)),
        stacks=labels[::-1],
        upload_bytes=sum(sizes),
        scratch_bytes=max(a + b for a, b in pairwise([0, *sizes, 0])),
    )


def find_scratch(resolved: ResolvedRecipe, store: StorePath) -> Path:
    """Return the folder on this machine in which these sequences are made, different for each shard."""
    ids = "\n".join(s.planned.id for s in resolved.sequences)
    name = quote(f"{store.scheme}-{store.key}", safe="")
    return Path("datasets") / f".{name}.{hashlib.sha256(ids.encode()).hexdigest()[:8]}"


def generate_to_store(
    resolved: ResolvedRecipe,
    store: StorePath,
    *,
    workers: int = 1,
    variant: str = "auto",
    cluster: str | None = None,
    keep_slices: str = "all",
    report: ReportProgress = lambda name, done: None,
    tell: Callable[[str], None] = lambda line: None,
) -> GenerationResult:
    """Make a dataset in an object store, or the parts of it that are missing there.

    Sequences of this recipe that the store holds are kept. The manifest is trusted if it lists a stream with the right
    fingerprint; otherwise the metadata of the stream decide. ``saf-gen verify`` reads all spikes.

    Parameters
    ----------
    resolved : ResolvedRecipe
        Result of :func:`saf_gen.generate.resolve.resolve_recipe`.
    store : StorePath
        Folder of the dataset in the store, as :func:`saf_gen.core.object_store.find_path` returns it.
    workers, variant, cluster, keep_slices, report, tell : optional
        See :func:`saf_gen.generate.run.generate`; uploads are reported too. The workers of a cluster must see the
        scratch folder, which is in the working directory.

    Returns
    -------
    GenerationResult
        Result of the run, with the store as its folder.

    Raises
    ------
    BadInput
        If ``generate`` would raise it, or if the store cannot be written to or fails; the same call then continues from
        the contents of the store.
    """
    scratch = find_scratch(resolved, store).resolve()
    before = check_same_dataset(resolved, store)
    check_store(store)
    check_writable(scratch)
    aborted, left = abort_uploads(store, own_names={s.planned.file for s in resolved.sequences})
    if aborted or left:
        tell(f"interrupted uploads: {aborted} removed, {left} left that may belong to other runs")
    listed = {entry.id: entry for entry in before.sequences} if before else {}
    transfer = StoreTransfer(resolved, store, scratch, report=report)
    in_store = transfer.find_entries(listed)
    leave_out = False
    if any(s.planned.id not in in_store for s in resolved.sequences) and resolved.recipe.render.diffraction is None:
        scratch.mkdir(parents=True, exist_ok=True)
        machines = None if cluster is None else Cluster(cluster, scratch, writes=True)
        leave_out = not choose_renderer(variant, cluster=machines, notify=tell)[1]
    if leave_out:
        resolved = resolved.without_diffraction()
        transfer = StoreTransfer(resolved, store, scratch, report=report)
        in_store = transfer.find_entries(listed)
    if any(in_store.get(name) != entry for name, entry in listed.items()):
        transfer.publish(in_store, with_others=False)  # so that sequences to be made again are not listed
    kept = [s.planned.id for s in resolved.sequences if s.planned.id in in_store]
    parts: list[GenerationResult] = []
    with ThreadPoolExecutor(1, "upload") as upload_pool:
        upload: Future[None] | None = None
        try:
            for batch in split_into_batches([s for s in resolved.sequences if s.planned.id not in in_store]):
                transfer.fetch_stacks(batch)
                part = generate(
                    replace(resolved, plan=tuple(batch), sequences=tuple(batch)),
                    scratch,
                    workers=workers,
                    variant=variant,
                    cluster=cluster,
                    keep_slices=keep_slices,
                    report=report,
                    tell=tell,
                )
                parts.append(part)
                if upload is not None:
                    upload.result()
                in_store |= {entry.id: entry for entry in part.manifest.sequences}
                upload = upload_pool.submit(
                    transfer.upload_batch, batch, part.manifest.sequences, in_store=dict(in_store)
                )
            if upload is not None:
                upload.result()
            manifest = transfer.publish(in_store, with_others=True)
        except BaseException:
            transfer.stop.set()
            raise
    failed = {name: error for part in parts for name, error in part.failed.items()}
    if not failed:
        shutil.rmtree(scratch, ignore_errors=True)
    return GenerationResult(
        store,
        manifest,
        rendered=[name for part in parts for name in part.rendered],
        recorded=[name for part in parts for name in part.recorded],
        kept=[*kept, *(name for part in parts for name in part.kept)],
        failed=failed,
        without_diffraction=leave_out,
        freed_bytes=sum(part.freed_bytes for part in parts),
    )


def split_into_batches(sequences: Iterable[ResolvedSequence]) -> list[list[ResolvedSequence]]:
    """Return the sequences in batches of about BATCH_BYTES, so that no stack belongs to two batches."""
    group_of: dict[StackSpec, list[ResolvedSequence]] = {}
    for sequence in sequences:
        group, specs = [sequence], stacks_of([sequence])
        for spec in specs:
            other = group_of.get(spec, group)
            if other is not group:
                other += group
                group_of |= dict.fromkeys(stacks_of(group), other)
                group = other
        group_of |= dict.fromkeys(specs, group)
    batches: list[list[ResolvedSequence]] = []
    remaining = 0
    for group in {id(one): one for one in group_of.values()}.values():
        size = _count_bytes(group)
        if not batches or size > remaining:
            batches, remaining = [*batches, []], BATCH_BYTES
        batches[-1].extend(group)
        remaining -= size
    return batches


def _count_bytes(sequences: list[ResolvedSequence]) -> int:
    pixel_frames = sum(s.frames * s.sensor.rows * s.sensor.columns for s in sequences)
    return bytes_of_stacks(stacks_of(sequences)) + bytes_of_streams(pixel_frames)
