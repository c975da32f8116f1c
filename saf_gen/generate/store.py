"""Generation of a dataset in an object store, through a scratch folder on this machine that stays small.

The dataset is made in batches of complete focal stacks and the recordings made from them. While a batch is made, the
previous one is uploaded: first its stacks, then its streams; each file is checked on arrival. The batch is then
deleted here, and the manifest that lists it is written. A manifest therefore never lists incomplete files, and a run
that was killed continues from what is in the store and in the scratch folder.
"""

import shutil
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from saf_gen.core.execution import Cluster, ReportProgress
from saf_gen.core.files import check_writable
from saf_gen.core.object_store import StorePath
from saf_gen.core.object_transfers import abort_uploads, check_store, download_file, list_objects, upload_file
from saf_gen.generate.plan import Plan, check_same_dataset, make_plan, split_into_batches, stacks_of
from saf_gen.generate.record import fingerprint_generated_out_of_focus
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence, recipe_fingerprint
from saf_gen.generate.run import GenerationResult, choose_renderer, find_entry, run_plan, write_dataset_manifest
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, SequenceEntry
from saf_gen.stream.sharing.croissant import CARD_NAME

TRANSFERS = 4
"""Number of files that are uploaded or downloaded at a time; each may take 150 MB of memory."""
CARDS = ("README.md", CARD_NAME, MANIFEST_NAME)
"""Files that describe the dataset, in the order in which they are uploaded: the manifest comes last."""


def run_to_store(
    plan: Plan,
    *,
    workers: int = 1,
    variant: str = "auto",
    cluster: str | None = None,
    report: ReportProgress = lambda name, done: None,
    tell: Callable[[str], None] = lambda line: None,
) -> GenerationResult:
    """Make what a dataset in an object store lacks.

    Sequences of this recipe that the store holds are kept. The manifest is trusted if it lists a stream with the right
    fingerprint; otherwise the metadata of the stream decide. ``saf-gen verify`` reads all spikes.

    Parameters
    ----------
    plan : Plan
        Result of :func:`saf_gen.generate.plan.make_plan`, whose target is in a store.
    workers, variant, cluster, report, tell : optional
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
    assert isinstance(plan.target, StorePath)
    resolved, store, scratch = plan.resolved, plan.target, plan.folder.resolve()
    check_store(store)
    check_writable(scratch)
    aborted, left = abort_uploads(store, own_names={s.planned.file for s in resolved.sequences})
    if aborted or left:
        tell(f"interrupted uploads: {aborted} removed, {left} left that may belong to other runs")
    listed = {entry.id: entry for entry in plan.manifest.sequences} if plan.manifest else {}
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
                of_batch = replace(resolved, all_sequences=tuple(batch), sequences=tuple(batch))
                part = run_plan(
                    make_plan(of_batch, scratch, keep_slices=plan.keep_slices),
                    workers=workers,
                    variant=variant,
                    cluster=cluster,
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


class StoreTransfer:
    """Moves stacks, streams and manifests of one dataset; setting ``stop`` ends uploads after the current files."""

    def __init__(self, resolved: ResolvedRecipe, store: StorePath, scratch: Path, *, report: ReportProgress) -> None:
        self._resolved, self._store, self._scratch, self._report = resolved, store, scratch, report
        self._stacks = scratch / "stacks"
        self._objects = list_objects(store)
        self.stop = threading.Event()

    def find_entries(self, listed: Mapping[str, SequenceEntry]) -> dict[str, SequenceEntry]:
        """Return the sequences of the recipe that the store holds, by id; ``listed`` holds the entries of its manifest.

        The notes of all stacks are fetched, because the fingerprints of sequences depend on them. Streams that the
        manifest does not list with the right fingerprint are opened, and read by ranges.
        """
        keys = {spec.key for sequence in self._resolved.all_sequences for spec in sequence.time_stack.specs}
        self._fetch(name for name in self._objects if name.endswith(".json") and _stack_key(name) in keys)
        digests: dict[TimeResolvedStack, str | None] = {}
        found = {}
        for sequence in self._resolved.all_sequences:
            stack, name = sequence.time_stack, sequence.planned.id
            if sequence.planned.file not in self._objects:
                continue
            if stack not in digests:
                digests[stack] = stack.digest(self._stacks) if stack.has_all_notes(self._stacks) else None
            digest, entry = digests[stack], listed.get(name)
            if entry is None or digest is None or not _has_settled_fingerprint(entry, sequence, stack_digest=digest):
                entry = find_entry(sequence, self._store, stack_digest=digest)
            if entry is not None:
                found[name] = entry
        return found

    def fetch_stacks(self, batch: Sequence[ResolvedSequence]) -> None:
        """Fetch the pieces of these sequences' stacks that the store holds, so that they are not rendered again."""
        keys = {spec.key for spec in stacks_of(batch)}
        self._fetch(name for name in self._objects if _stack_key(name) in keys)

    def _fetch(self, names: Iterable[str]) -> None:
        missing = [name for name in names if not (self._scratch / name).exists()]
        with ThreadPoolExecutor(TRANSFERS) as pool:
            list(pool.map(lambda name: download_file(self._store / name, self._scratch / name), missing))

    def upload_batch(
        self,
        batch: Sequence[ResolvedSequence],
        finished: Sequence[SequenceEntry],
        *,
        in_store: Mapping[str, SequenceEntry],
    ) -> None:
        """Upload the stacks and the finished streams of a batch, delete them here, and publish the new manifest.

        ``in_store`` holds all sequences that the store then contains, by id.
        """
        specs = stacks_of(batch)
        of_stacks = [path for spec in specs for path in (self._stacks / spec.key).glob("[!.]*")]
        of_stacks += [path for spec in specs if (path := self._scratch / "preview" / f"{spec.key}.png").exists()]
        streams = [self._scratch / entry.file for entry in finished]
        for files in (of_stacks, streams):
            with ThreadPoolExecutor(TRANSFERS) as pool:
                list(pool.map(self._upload, files))
        if self.stop.is_set():
            return
        for stream in streams:
            stream.unlink(missing_ok=True)
        for spec in specs:
            StackStore(self._stacks, spec).delete_pictures()  # notes stay, because the manifest names the renderer
        self.publish(in_store, with_others=True)

    def _upload(self, file: Path) -> None:
        name = file.relative_to(self._scratch).as_posix()
        if self.stop.is_set() or (name in self._objects and _stack_key(name)):  # it was fetched from the store
            return
        report = self._report if file.suffix == ".h5" else lambda name, done: None  # stacks may have 1,000 pieces
        report(f"upload {name}", 0.0)
        upload_file(file, self._store / name)
        report(f"upload {name}", 1.0)

    def publish(self, in_store: Mapping[str, SequenceEntry], *, with_others: bool) -> Manifest:
        """Write the manifest and the cards for the sequences in the store, and upload them; the manifest comes last.

        With ``with_others``, sequences that other shards of the recipe have listed in the meantime are kept.
        """
        known = dict(in_store)
        now = check_same_dataset(self._resolved, self._store) if with_others else None
        if now is not None and now.recipe_fingerprint == recipe_fingerprint(self._resolved.recipe):
            known = {entry.id: entry for entry in now.sequences} | known
        entries = [known[s.planned.id] for s in self._resolved.all_sequences if s.planned.id in known]
        if CARD_NAME in self._objects:
            self._fetch([CARD_NAME])  # it holds the date of the first publication
        manifest = write_dataset_manifest(self._resolved, self._scratch, entries=entries, stacks=self._stacks)
        for name in CARDS:
            upload_file(self._scratch / name, self._store / name)
        return manifest


def _stack_key(name: str) -> str:
    """Return the key of the stack to which an object belongs; '' if it belongs to none."""
    parts = name.split("/")
    return parts[1] if len(parts) == 3 and parts[0] == "stacks" else ""


def _has_settled_fingerprint(entry: SequenceEntry, sequence: ResolvedSequence, *, stack_digest: str) -> bool:
    """Return whether a manifest alone shows that a stream is a recording of this sequence.

    If a moving scene has a mean rate, the fingerprint of the plan is right only if the lens meets the focus, as the
    stream says.
    """
    planned = sequence.fingerprint(stack_digest)
    depends = sequence.time_stack.is_moving and sequence.planned.mean_rate is not None
    return entry.fingerprint == (fingerprint_generated_out_of_focus(planned) if depends else planned)
