"""Ranking of methods on SAF's recordings by its authors' protocol and by ours, compared with other rankings.

SAF is the spike-camera autofocus of Su et al. (CVPR 2024), with its code and recordings. The authors' programs score
consecutive blocks of ``dt`` frames; their list gives ``dt`` for each recording. They print the last frame of the best
block, counted from 1; the golden-section searches print the middle of their last interval. The truth is a frame
chosen by hand. The authors state neither a limit within which an answer is right nor a table of errors. Later work
on the same recordings (CEN, ICML 2026) reports errors in blocks. Methods are therefore ranked here by the error of
their answers as a fraction of the recording. The depth of focus is unknown, because lens, aperture and pixels are not
stated.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path

from saf_gen.benchmark.evaluate import ProgressCallback, evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import DEFAULT_RECORDED_METHODS, Method, parse_method, split_options, split_region
from saf_gen.benchmark.records import Record, read_records
from saf_gen.benchmark.results import Evaluation
from saf_gen.benchmark.tracks.recorded_track import check_leaves_lens
from saf_gen.core.config.registry import refuse_code
from saf_gen.errors import BadInput, escape_controls
from saf_gen.leaderboard.rank_agreement import RankAgreement
from saf_gen.leaderboard.saf_ranking import SafAnswer, SafRow, compare_saf_rankings, rank_saf_answers
from saf_gen.leaderboard.table_formats import format_leaderboard_count
from saf_gen.stream.dataset import index_folder
from saf_gen.stream.interop.saf_folder import CONFIG, SafRecording, import_saf_folder, read_saf_config
from saf_gen.stream.manifest import ALL_SPLITS, MANIFEST_NAME

STREAMS = "recordings"
BLOCK_OPTIONS = ("window", "dt")
"""Options of a search that give the number of frames of a block."""
PRINTS_LAST_FRAME = ("argmax",)
"""Searches for which SAF's programs print the last frame of a block; for others, they print the answer itself."""


@dataclass(frozen=True)
class SafRanking:
    """Methods ranked on SAF's recordings, and the agreement of the ranking with others.

    Attributes
    ----------
    rows : tuple of SafRow
        One for each method, best first.
    answers : tuple of SafAnswer
        One for each method and recording.
    agreement : tuple of RankAgreement
        Agreement of the rankings by SAF's protocol and by ours, with each other and with each evaluation of other data.
    beside : tuple of str
        Names of the evaluations of other data.
    left_out : mapping of str to str
        Methods of these evaluations that were not run, with the reasons.
    own : Evaluation
        The evaluation by our protocol, as ``saf-gen evaluate`` makes it.
    """

    rows: tuple[SafRow, ...]
    answers: tuple[SafAnswer, ...]
    agreement: tuple[RankAgreement, ...]
    beside: tuple[str, ...]
    left_out: Mapping[str, str]
    own: Evaluation


def rank_methods_on_saf_folder(
    folder: Path,
    out: Path,
    *,
    methods: Sequence[str] | None = None,
    beside: Sequence[Path] = (),
    readout_hz: float = 20_000,
    progress: ProgressCallback | None = None,
    notify: Callable[[str], None] = lambda line: None,
) -> SafRanking:
    """Rank methods on a folder of SAF's recordings.

    Parameters
    ----------
    folder : Path
        Folder that holds ``config.xlsx`` and the raw files that it lists.
    out : Path
        Folder for the streams, in ``recordings/``, and for results that are kept until the ranking is written.
    methods : sequence of str, optional
        Names of methods; by default those methods of ``beside`` whose code is registered, or the default methods if
        ``beside`` is empty.
    beside : sequence of Path, optional
        Evaluations of other data, such as a generated test split, whose rankings are compared with this ranking.
    readout_hz : float, default 20000
        Readouts per second, which the raw files do not record.
    progress : callable, optional
        Called with the number of steps done, the number of all steps, and a description of the last step.
    notify : callable, optional
        Called with lines of text for the user.

    Returns
    -------
    SafRanking
        The ranking; it is not written to files.

    Raises
    ------
    BadInput
        If the folder or an evaluation cannot be read, a recording has no block length, ``out`` holds streams of other
        recordings, two evaluations have the same name, an evaluation is of the closed loop, no method of ``beside`` is
        available, or the recordings cannot be evaluated.
    """
    listed = read_saf_config(folder)
    for recording in listed:
        if recording.block is None:
            raise BadInput(
                f"{recording.name} has no dt", where=str(folder / CONFIG), allowed="the frames per block, at least 1"
            )
    runs = {_name_run(run): read_records(run) for run in beside}
    for run, judged in runs.items():
        if {record.track for record in judged} != {"recorded"}:
            raise BadInput(f"{run} is an evaluation of the closed loop", allowed="evaluations of recordings")
    if len(runs) < len(beside):
        raise BadInput("two evaluations have the same name", allowed="different names", hint="rename a folder")
    for run, judged in runs.items():
        if len(splits := dict.fromkeys(record.split or "no split" for record in judged)) > 1:
            notify(escape_controls(f"{run} ranks several splits together: {', '.join(splits)}"))
    chosen, left_out = _choose_methods(methods, runs)
    check_leaves_lens(chosen)
    streams = _import_recordings(folder, listed, streams=out / STREAMS, readout_hz=readout_hz)
    recordings = {f"blocks-{recording.block}-{recording.name}": recording for recording in listed}
    stores = [KeptSequences(out / ".ours.unfinished")]
    own = evaluate(
        streams, methods=[method.name for method in chosen], split=ALL_SPLITS, progress=progress, keep=stores[0]
    )
    stores[0].write()
    failures, records = list(own.failures), {(r.method, r.sequence): r for r in own.records}
    theirs: dict[tuple[str, str], tuple[float | None, int | None]] = {}
    for block in sorted({recording.block for recording in listed if recording.block}):
        set_methods = {method.name: _set_block(method, block) for method in chosen}
        stores.append(KeptSequences(out / f".blocks-{block}.unfinished"))
        found = evaluate(
            streams,
            methods=[method.name for method in set_methods.values()],
            split=f"blocks-{block}",
            progress=progress,
            keep=stores[-1],
            draw=False,
        )
        stores[-1].write()
        failures += found.failures
        by_name = {(record.method, record.sequence): record for record in found.records}
        for label, method in set_methods.items():
            for sequence in {sequence for _, sequence in by_name}:
                record, recording = by_name[method.name, sequence], recordings[sequence]
                theirs[label, sequence] = _print_frame(record, method), _count_blocks(record, recording)
    if failures:
        raise BadInput(failures[0].problem, where=f"{streams}: {failures[0].sequence}")
    reused = max(one.reused for one in stores)
    if reused:
        notify(f"{format_leaderboard_count(reused, 'recording')} had been evaluated by a run that was stopped")
    answers = tuple(
        SafAnswer(
            method,
            recordings[sequence].name,
            record.scene,
            recordings[sequence].frames,
            recordings[sequence].block or 0,
            recordings[sequence].focal_frame + 1,
            *theirs[method, sequence],
            None if record.frame is None else record.frame + 1,
        )
        for (method, sequence), record in records.items()
    )
    rows = rank_saf_answers(answers, runs)
    return SafRanking(rows, answers, compare_saf_rankings(answers, runs), tuple(runs), left_out, own)


def remove_kept_results_of_ranking(out: Path) -> None:
    """Remove the results that allow a stopped run to continue; called after the ranking is written."""
    for folder in out.glob(".*.unfinished"):
        KeptSequences(folder).remove()


def _name_run(run: Path) -> str:
    """Return the name of an evaluation's folder or, if it is ``evaluation``, the name of the folder above it."""
    folder = (run if run.is_dir() else run.parent).resolve()
    return folder.parent.name if folder.name == "evaluation" else folder.name


def _choose_methods(
    methods: Sequence[str] | None, runs: Mapping[str, Sequence[Record]]
) -> tuple[list[Method], dict[str, str]]:
    """Return the methods to run, and those of evaluations that are left out, with the reasons."""
    left_out: dict[str, str] = {}
    if methods is not None:
        found = [parse_method(name) for name in methods]
        return list({method.name: method for method in found}.values()), left_out
    chosen: dict[str, Method] = {}
    for run, records in runs.items():
        for label in dict.fromkeys(record.method for record in records):
            try:
                with refuse_code(run):
                    chosen.setdefault(label, parse_method(label))
            except BadInput as error:
                left_out[label] = error.problem
    if runs and not chosen:
        raise BadInput(f"no method of {', '.join(runs)} is available", hint="name methods: --method or --methods")
    return list(chosen.values()) or [parse_method(name) for name in DEFAULT_RECORDED_METHODS], left_out


def _import_recordings(folder: Path, listed: Sequence[SafRecording], *, streams: Path, readout_hz: float) -> Path:
    """Write the recordings as a dataset with one split per block length; return its folder."""
    names = {streams / f"blocks-{recording.block}" / f"{recording.name}.h5" for recording in listed}
    for path in sorted(streams.rglob("*.h5")):
        if path not in names:
            raise BadInput(f"{path} is not a recording of {folder}", hint="choose another --out")
    (streams / MANIFEST_NAME).unlink(missing_ok=True)
    for _ in import_saf_folder(folder, streams, readout_hz=readout_hz, by_block=True):
        pass
    index_folder(streams)
    return streams


def _set_block(method: Method, block: int) -> Method:
    """Return the method with this block length, or unchanged if its name states a length or it has no blocks."""
    name, region = split_region(method.name)
    stated_options = split_options(name.split("+")[-1])[1] if "+" in name else ""
    names = {field.name for field in fields(method.search)} if is_dataclass(method.search) else frozenset[str]()
    options = [key for key in BLOCK_OPTIONS if key in names]
    if (
        name.startswith("@")
        or not options
        or any(item.startswith(f"{options[0]}=") for item in stated_options.split(","))
    ):
        return method
    text = f"{name}{',' if stated_options else ':'}{options[0]}={block}"
    with refuse_code("this method"):  # its code is already loaded
        return parse_method(f"{text}@{region}" if region else text)


def _print_frame(record: Record, method: Method) -> float | None:
    """Return the frame that SAF's programs print, counted from 1; for a block, this is its last frame."""
    if record.frame is None:
        return None
    block = getattr(method.search, "window", 1) if method.search_name in PRINTS_LAST_FRAME else 1
    return record.frame + 1 + (block - 1) / 2


def _count_blocks(record: Record, recording: SafRecording) -> int | None:
    """Return the number of blocks between answer and truth, as CEN counts them.

    The frame of the truth is counted from 1 here, although blocks are counted from frame 0.
    """
    block = recording.block or 1
    return None if record.frame is None else abs(int(record.frame // block) - (recording.focal_frame + 1) // block)
