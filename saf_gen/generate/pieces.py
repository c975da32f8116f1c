"""The pieces of a dataset: what is made as a whole or not at all, and what each of them needs.

A piece is a picklable value that names its files. A run takes the list of pieces that :func:`pieces_of` makes of a plan
and makes each as soon as what it needs is made; a piece that is there costs nothing. Another kind of piece is a class
here and a line in that list: shards, resuming and clusters take it as it is.
"""

from abc import ABC, abstractmethod
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from saf_gen.core.cores import defer_interrupts, usable_cores
from saf_gen.core.execution import ReportProgress
from saf_gen.core.files import undeletable, unwritable
from saf_gen.generate.plan import Plan
from saf_gen.generate.record import Recorder, recording_digest
from saf_gen.generate.resolve import ResolvedSequence
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.grain import read_grain
from saf_gen.stack.picture_stack import PictureStack
from saf_gen.stack.same_scene import require_same_scene
from saf_gen.stack.second_render import stacks_to_repeat
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack

COMPUTED_FRACTION = 0.99
"""Progress of a piece once everything is computed; it becomes 1 when its files have their final names."""
MAX_OTHERS = 8
"""Stacks of a scene and its parameters with which each further one is compared; more would not show more."""


@dataclass(frozen=True)
class Site:
    """Where pieces are made, and by what.

    Attributes
    ----------
    folder : Path
        Folder of the dataset.
    recorder : Recorder
        Records its sequences.
    side_by_side : int, default 1
        Number of recordings that share the cores of a machine.
    backend : str, default ''
        Rendering backend, if the piece renders.
    """

    folder: Path
    recorder: Recorder
    side_by_side: int = 1
    backend: str = ""

    @property
    def stacks(self) -> Path:
        """Folder of stacks."""
        return self.folder / "stacks"


class Piece(ABC):
    """Something that a dataset consists of, or that is done to it.

    Attributes
    ----------
    takes_all_cores : bool
        Whether making it uses every core.
    renders : bool
        Whether it needs a renderer.
    """

    takes_all_cores: ClassVar[bool] = False

    @property
    def renders(self) -> bool:
        return False

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the work, in messages."""

    @property
    def needs(self) -> tuple["Piece", ...]:
        """The pieces that must be made before it; those that are there are not made again."""
        return ()

    def is_there(self, site: Site) -> bool:
        """Return whether there is nothing to make, by the names of files and their notes."""
        return False

    def can_be_made(self, site: Site) -> bool:
        """Return whether it can be made now that its needs are there; else another run makes it."""
        return True

    @abstractmethod
    def make(self, site: Site, report: ReportProgress) -> Any:
        """Make it and return a small result."""

    def lacks(self, result: Any) -> "Piece | None":
        """Return the piece that must be made again before this one, as its result says, or None."""
        return None


@dataclass(frozen=True, eq=False)
class Pictures(Piece):
    """The pictures of a time-resolved stack, rendered where they are missing, or taken in; makes the names of parts.

    Attributes
    ----------
    label : str
        Name of the stack in messages.
    scene : Scene or PictureStack
        Scene of the stack, or the pictures that are taken in instead of being rendered.
    stack : TimeResolvedStack
        The stack.
    missing : bool, default False
        Whether anything is to be made; pictures that were deleted on purpose are not missing.
    measure_grain : bool, default True
        Whether to measure the grain of the stored pictures too.
    run : tuple of StackSpec, optional
        The slices that are rendered, if other shards render the rest; by default all.
    others : tuple of StackSpec, optional
        Other stacks of the scene with the same parameters, which must show the same.
    """

    label: str
    scene: Scene | PictureStack
    stack: TimeResolvedStack
    missing: bool = False
    measure_grain: bool = True
    run: tuple[StackSpec, ...] | None = None
    others: tuple[StackSpec, ...] = ()
    takes_all_cores = True

    @property
    def name(self) -> str:
        return f"{'take in' if isinstance(self.scene, PictureStack) else 'render'} {self.label}"

    @property
    def renders(self) -> bool:
        return not isinstance(self.scene, PictureStack)

    def is_there(self, site: Site) -> bool:
        return not self.missing

    def make(self, site: Site, report: ReportProgress) -> list[str]:
        try:
            if isinstance(self.scene, PictureStack):
                return self.scene.take_in(self.stack.specs[0], site.stacks)
            return self._render(self.scene, site, report=report)
        except OSError as error:
            raise unwritable(site.stacks, error) from error

    def _render(self, scene: Scene, site: Site, *, report: ReportProgress) -> list[str]:
        from saf_gen.render import render_missing  # so that only a process that renders loads Mitsuba
        from saf_gen.render.grain import measure_by_repeat

        building, reported = f"{self.name} · build", set[str]()
        report(building, 0.0)  # the code of a scene may take any time, and should not do so in silence

        def progress(piece: str, done: float) -> None:
            if not reported:
                report(building, 1.0)
            reported.add(f"{self.name} · {piece}")
            report(f"{self.name} · {piece}", COMPUTED_FRACTION * done)

        def report_done() -> None:
            for piece in sorted(reported):
                report(piece, 1.0)

        options: dict[str, Any] = {"root": site.stacks, "backend_name": site.backend, "progress": progress}
        parts = render_missing(
            scene, self.stack.specs, **options, wanted=self.run, others=self.others, geometry_first=self.run is not None
        )
        report_done()
        if self.measure_grain:
            measure_by_repeat(scene, self.stack.specs, **options)
            report_done()
        return parts


@dataclass(frozen=True, eq=False)
class Grain(Piece):
    """The grain of a shard's slices of a stack that other shards render, too; it chooses them when it is made.

    Attributes
    ----------
    pictures : Pictures
        The shard's slices.
    after : tuple of Piece
        All pictures of the shard, after which it looks at what the others have made.
    specs : frozenset of StackSpec
        The shard's slices of all stacks.
    """

    pictures: Pictures
    after: tuple[Piece, ...]
    specs: frozenset[StackSpec]
    takes_all_cores = True

    @property
    def name(self) -> str:
        return f"measure the grain of {self.pictures.label}"

    @property
    def renders(self) -> bool:
        return self.pictures.renders

    @property
    def needs(self) -> tuple[Piece, ...]:
        return self.after

    def _lacking(self, site: Site) -> tuple[StackSpec, ...]:
        """Return the slices of this shard whose grain is to be measured; none if that cannot be known yet."""
        stack = self.pictures.stack
        if not stack.has_geometry(site.stacks):
            return ()
        mine = [spec for spec in stacks_to_repeat(stack.specs, site.stacks) if spec in self.specs]
        return tuple(spec for spec in mine if read_grain(site.stacks, spec) is None)

    def is_there(self, site: Site) -> bool:
        return not (self.renders and self._lacking(site))

    def make(self, site: Site, report: ReportProgress) -> None:
        from saf_gen.render.grain import measure_by_repeat

        if isinstance(scene := self.pictures.scene, PictureStack):  # its grain is not that of a renderer
            return
        try:
            measure_by_repeat(
                scene,
                self.pictures.stack.specs,
                root=site.stacks,
                backend_name=site.backend,
                wanted=self._lacking(site),
                progress=lambda name, done: report(self.name, COMPUTED_FRACTION * done),
            )
        except OSError as error:
            raise unwritable(site.stacks, error) from error


@dataclass(frozen=True)
class RecordResult:
    """The result of making a recording.

    Attributes
    ----------
    content_sha256 : str
        Digest of the content of the recording; '' if it lacks slices.
    kept : bool
        Whether an earlier run had already made the recording.
    lacks_slices : bool, default False
        Whether the recording is not finished, because its file is missing or damaged and its time slices have been
        deleted.
    """

    content_sha256: str
    kept: bool
    lacks_slices: bool = False


@dataclass(frozen=True, eq=False)
class Recording(Piece):
    """The recording of a sequence; one with the same fingerprint whose content matches its digest is kept.

    Attributes
    ----------
    sequence : ResolvedSequence
        The sequence.
    pictures : Pictures
        Pictures of its stack. It fails if these and those of other stacks do not show the same scene.
    grain : Grain, optional
        Of a stack that several shards render: it is then recorded by a shard that sees the stack whole.
    """

    sequence: ResolvedSequence
    pictures: Pictures
    grain: Grain | None = None

    @property
    def name(self) -> str:
        return f"record {self.sequence.planned.id}"

    @property
    def needs(self) -> tuple[Piece, ...]:
        return (self.pictures,) if self.grain is None else (self.grain,)

    def can_be_made(self, site: Site) -> bool:
        stack = self.sequence.time_stack
        return self.grain is None or not (stack.find_missing(site.stacks) or not stack.has_grain(site.stacks))

    def make(self, site: Site, report: ReportProgress) -> RecordResult:
        stack, path = self.sequence.time_stack, site.folder / self.sequence.planned.file
        fingerprint = self.sequence.fingerprint(stack.digest(site.stacks))
        digest = recording_digest(path, fingerprint)
        if digest is not None:
            return RecordResult(digest, kept=True)
        if stack.is_moving and stack.find_missing(site.stacks):
            return RecordResult("", kept=False, lacks_slices=True)
        require_same_scene(site.stacks, [*stack.specs, *self.pictures.others])
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            digest = site.recorder.record(
                self.sequence.planned,
                PlaneSource.from_folder(stack, site.stacks),
                path=path,
                fingerprint=fingerprint,
                threads=max(1, usable_cores() // site.side_by_side),
                progress=lambda done: report(self.name, COMPUTED_FRACTION * done),
            )
        except OSError as error:
            raise unwritable(path, error) from error
        return RecordResult(digest, kept=False)

    def lacks(self, result: RecordResult) -> Piece | None:
        return self.pictures if result.lacks_slices and self.grain is None else None


@dataclass(frozen=True, eq=False)
class Deletion(Piece):
    """Time slices that are not kept, deleted if all recordings made from them can be read back; makes the bytes freed.

    If one of the recordings, in all splits of the recipe, is missing, damaged or has another fingerprint, nothing is
    deleted and the result is 0. The notes of the slices stay, to show that the recordings were made from them; without
    recordings, the notes are deleted too.

    Attributes
    ----------
    specs : tuple of StackSpec
        The slices.
    users : tuple of ResolvedSequence
        All sequences of the recipe that are recorded from them.
    recordings : tuple of Recording
        Those of them that this run makes.
    """

    specs: tuple[StackSpec, ...]
    users: tuple[ResolvedSequence, ...]
    recordings: tuple[Recording, ...]

    @property
    def name(self) -> str:
        return f"delete time slices of {self.users[0].planned.label if self.users else 'the closed loop'}"

    @property
    def needs(self) -> tuple[Piece, ...]:
        return self.recordings

    def is_there(self, site: Site) -> bool:
        return not any((site.stacks / spec.key).exists() for spec in self.specs)

    def make(self, site: Site, report: ReportProgress) -> int:
        digests = {stack: stack.digest(site.stacks) for stack in {s.time_stack for s in self.users}}
        for s in self.users:
            if recording_digest(site.folder / s.planned.file, s.fingerprint(digests[s.time_stack])) is None:
                return 0
        try:
            stores = [StackStore(site.stacks, spec) for spec in self.specs if (site.stacks / spec.key).exists()]
            return sum(store.delete_pictures() if self.users else store.delete() for store in stores)
        except OSError as error:
            raise undeletable(site.stacks, error) from error


@dataclass(frozen=True, eq=False)
class Renderer(Piece):
    """The choice of a backend on the machine that renders: its name, and whether it renders diffraction.

    Attributes
    ----------
    requested : str
        Name of a backend, or "auto".
    """

    requested: str
    name = "choose the renderer"

    @property
    def renders(self) -> bool:
        return self.requested in ("auto", "cuda")

    def make(self, site: Site, report: ReportProgress) -> tuple[str, bool]:
        with defer_interrupts():
            from saf_gen.render import backend  # loads Mitsuba, so only when something must be rendered

        chosen = backend.choose_backend(self.requested)
        return chosen, backend.can_render_waves(chosen)


@dataclass(frozen=True, eq=False)
class Work:
    """The making of a piece, as a job that can be sent to another process."""

    piece: Piece
    site: Site

    @property
    def name(self) -> str:
        return self.piece.name

    @property
    def takes_all_cores(self) -> bool:
        return self.piece.takes_all_cores

    @property
    def wants_gpu(self) -> bool:
        return self.piece.renders and self.site.backend in ("auto", "cuda")

    def run(self, report: ReportProgress) -> Any:
        report(self.name, 0.0)
        result = self.piece.make(self.site, report)
        report(self.name, 1.0)
        return result


def pieces_of(plan: Plan) -> list[Piece]:
    """Return all pieces of a plan: pictures, what is made of them, and what is deleted in the end.

    A shard renders its slices of cut stacks first. When it has rendered everything, it looks at these stacks again: it
    measures the grain of its own slices if all slices have depth and target, and records what can be recorded. Two
    shards that see this at once begin with different sequences, and keep those that the other has made.
    """
    others = _other_stacks(plan)

    def pictures_of(stack: TimeResolvedStack) -> Pictures:
        user, missing = plan.users[stack], plan.to_render.get(stack)
        cut = plan.shard is not None and stack in plan.shard.cut
        return Pictures(
            user.stack_label(stack),
            user.scene,
            stack,
            missing=missing is not None,
            measure_grain=stack in plan.by_stack,
            run=missing if cut else None,
            others=others(stack),
        )

    pictures = {stack: pictures_of(stack) for stack in [*plan.to_render, *plan.by_stack, *plan.by_cut_stack]}
    pieces: list[Piece] = [*pictures.values()]
    recordings = [Recording(s, pictures[stack]) for stack, users in plan.by_stack.items() for s in users]
    for stack, users in plan.by_cut_stack.items():
        rendered, specs = tuple(pictures.values()), frozenset[StackSpec]() if plan.shard is None else plan.shard.specs
        pieces.append(grain := Grain(pictures[stack], rendered, specs))
        first = plan.resolved.part[0] % max(len(users), 1)
        recordings += [Recording(s, pictures[stack], grain) for s in (*users[first:], *users[:first])]
    pieces += recordings
    for ids, specs_of_group in plan.deletable.items():
        users_of_group = tuple(s for s in plan.resolved.all_sequences if s.planned.id in ids)
        mine = tuple(piece for piece in recordings if piece.sequence.planned.id in ids)
        if mine or not ids:
            pieces.append(Deletion(tuple(specs_of_group), users_of_group, mine))
    return pieces


def _other_stacks(plan: Plan) -> Callable[[TimeResolvedStack], tuple[StackSpec, ...]]:
    """Return what gives the first slices of a few other stacks of the recipe with a stack's scene and parameters."""
    alike = defaultdict[tuple[str, str, str], list[StackSpec]](list)
    for spec in dict.fromkeys(stack.specs[0] for s in plan.resolved.all_sequences for stack in s.stacks):
        alike[spec.scene, spec.scene_digest, spec.params].append(spec)

    def others(stack: TimeResolvedStack) -> tuple[StackSpec, ...]:
        first = stack.specs[0]
        return tuple(
            spec for spec in alike[first.scene, first.scene_digest, first.params][:MAX_OTHERS] if spec != first
        )

    return others


class Schedule:
    """What of a list of pieces can be made, at first and after each that was made.

    Parameters
    ----------
    pieces : sequence of Piece
        All pieces.
    site : Site
        Where they are made.
    choose_backend : callable
        Returns the backend to render with; called at most once, when something must be rendered.
    """

    def __init__(self, pieces: Sequence[Piece], site: Site, *, choose_backend: Callable[[], str]) -> None:
        self._pieces, self._site, self._choose_backend = pieces, site, cache(choose_backend)
        self._waiting, self._made, self._again = set(pieces), set[Piece](), set[Piece]()
        self._dependents = defaultdict[Piece, list[Piece]](list)
        for piece in pieces:
            for need in piece.needs:
                self._dependents[need].append(piece)

    def first(self) -> list[Work]:
        """Return the work that waits for nothing."""
        return self._ready(self._pieces)

    def after(self, work: Work, result: Any) -> list[Work]:
        """Return the work that can start now that a piece was made with this result.

        If the piece lacks one that was there, that one is made again, once, and then all that needs it.
        """
        piece = work.piece
        if (lacking := piece.lacks(result)) is not None:
            if lacking in self._again:
                return []
            self._again.add(lacking)
            redone = [lacking, *self._dependents[lacking]]
            self._made.difference_update(redone)
            self._waiting.update(redone)
            return self._ready([lacking])
        if piece in self._waiting:  # it is made once more
            return []
        self._made.add(piece)
        return self._ready(self._dependents[piece])

    def _ready(self, pieces: Iterable[Piece]) -> list[Work]:
        """Return the work on those of some pieces, and of what needs them, that can start."""
        works, queue = list[Work](), deque(pieces)
        while queue:
            piece = queue.popleft()
            if piece not in self._waiting or not self._made.issuperset(piece.needs):
                continue
            self._waiting.discard(piece)
            if piece not in self._again and piece.is_there(self._site):
                self._made.add(piece)
                queue.extend(self._dependents[piece])
            elif piece.can_be_made(self._site):
                backend = self._choose_backend() if piece.renders else ""
                works.append(Work(piece, replace(self._site, backend=backend)))
        return works
