"""Ranking of methods on SAF's recordings by its authors' protocol and by ours, compared with other rankings.

SAF is the spike-camera autofocus of Su et al. (CVPR 2024), with its code and recordings. The authors' programs score
consecutive blocks of ``dt`` frames; their list gives ``dt`` for each recording. They print the last frame of the best
block, counted from 1; the golden-section searches print the middle of their last interval. The truth is a frame
chosen by hand. The authors state neither a limit within which an answer is right nor a table of errors. Later work
on the same recordings (CEN, ICML 2026) reports errors in blocks. Methods are therefore ranked here by the error of
their answers as a fraction of the recording. The depth of focus is unknown, because lens, aperture and pixels are not
stated.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from saf_gen import __version__
from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.evaluate import ProgressCallback, evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import DEFAULT_RECORDED_METHODS, Method, split_halves, split_options, split_region
from saf_gen.benchmark.records import Record, read_records
from saf_gen.benchmark.results import Evaluation
from saf_gen.benchmark.tracks.recorded import check_leaves_lens
from saf_gen.core.config.registry import refuse_code
from saf_gen.core.files import write_text
from saf_gen.core.plain_text import escape_markdown, plural
from saf_gen.core.table import Column, Table, percent
from saf_gen.errors import BadInput, escape_controls
from saf_gen.leaderboard.outcomes import group_by, mean_by_scene, right_within
from saf_gen.leaderboard.rank_agreement import RankAgreement, compare_scores
from saf_gen.leaderboard.short_names import name_list
from saf_gen.leaderboard.tables import AGREEMENT_MEANINGS, agreement
from saf_gen.stream.dataset import index_folder
from saf_gen.stream.interop.saf_folder import CONFIG, SafRecording, import_saf_folder, read_saf_config
from saf_gen.stream.manifest import ALL_SPLITS, MANIFEST_NAME

STREAMS = "recordings"
BLOCK_OPTIONS = ("window", "dt")
"""Options of a search that give the number of frames of a block."""
PRINTS_LAST_FRAME = ("argmax",)
"""Searches for which SAF's programs print the last frame of a block; for others, they print the answer itself."""
THEIRS, OURS = "SAF's protocol", "ours, same recordings"
PROTOCOL_NOTES = (
    "SAF's protocol: blocks of dt frames, with dt from config.xlsx; the answer is the last frame of the best block,"
    " counted from 1; the truth is a frame chosen by hand. The authors state neither a limit within which an answer is"
    " right nor a table of errors; they plot the printed frame together with the chosen frame. CEN (ICML 2026) reports"
    " mean errors in blocks. Methods are ranked by the mean error over scenes, as a fraction of the recording;"
    " a missing answer counts as the largest possible error.",
    "Our protocol: the same recordings; each search uses its own windows and answers with the centre of a window. In"
    " both protocols, measures look at the whole frame, because these recordings name no target.",
    "Unknown for these recordings: lens, aperture, pixels, the position of the lens in each frame (it is assumed to"
    " move evenly), the error of the chosen frame, and the light schedule. Therefore the depth of focus and success"
    " within it are unknown.",
)


@dataclass(frozen=True)
class SafAnswer:
    """The answer of a method on a recording, with frames counted from 1 as SAF's programs do; None for no answer."""

    method: str
    recording: str
    scene: str
    frames: int
    block: int
    truth: int
    printed: float | None
    blocks: int | None
    """Number of blocks between the answer and the truth, as the code of CEN (ICML 2026) counts them."""
    own: float | None
    """Answer by our protocol: the centre of a window, counted from 1; the search keeps its own options."""

    @property
    def error(self) -> float | None:
        """Printed frame minus the frame chosen by hand; None for no answer."""
        return None if self.printed is None else self.printed - self.truth

    @property
    def own_error(self) -> float | None:
        """Answer by our protocol minus the frame chosen by hand; None for no answer."""
        return None if self.own is None else self.own - self.truth

    def fraction_off(self, error: float | None) -> float:
        """Return an error in frames as a fraction of the recording, 0 to 1; None counts as the largest error."""
        off = max(self.truth - 1, self.frames - self.truth) if error is None else abs(error)
        return off / self.frames


@dataclass(frozen=True)
class SafRow:
    """Result of one method on all recordings.

    Attributes
    ----------
    rank, own_rank : int
        Rank by ``off``, under SAF's protocol, and by ``own_off``, under ours; 1 is the best.
    method : str
        Name of the method.
    off, own_off : float
        Mean absolute error over scenes, as a fraction of the recording, under SAF's protocol and under ours. A missing
        answer counts as the largest possible error.
    error_frames, own_error_frames : float or None
        Median absolute error of the answers, in frames; None if there is no answer.
    error_blocks : float or None
        Mean error of the answers in blocks, as the code of CEN computes it; None if there is no answer.
    within_block : float
        Fraction of recordings, 0 to 1, whose answer under SAF's protocol is at most one block from the truth.
    unanswered : int
        Number of recordings without an answer under SAF's protocol.
    beside : tuple of (float or None)
        Success within 1 depth of focus in each evaluation of other data; None if the evaluation lacks the method.
    """

    rank: int
    method: str
    off: float
    error_frames: float | None
    error_blocks: float | None
    within_block: float
    unanswered: int
    own_rank: int
    own_off: float
    own_error_frames: float | None
    beside: tuple[float | None, ...]


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
    broke : tuple of Record
        Records, by either protocol, of methods whose own code broke.
    """

    rows: tuple[SafRow, ...]
    answers: tuple[SafAnswer, ...]
    agreement: tuple[RankAgreement, ...]
    beside: tuple[str, ...]
    left_out: Mapping[str, str]
    own: Evaluation
    broke: tuple[Record, ...] = ()


def rank_on_saf(
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
        ``beside`` is empty. Methods that are not part of saf_gen run as guests, as in an evaluation.
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
    broke = [record for record in own.records if record.broke]
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
            check=False,
        )
        stores[-1].write()
        failures += found.failures
        broke += [record for record in found.records if record.broke]
        by_name = {(record.method, record.sequence): record for record in found.records}
        for label, method in set_methods.items():
            for sequence in {sequence for _, sequence in by_name}:
                record, recording = by_name[method.name, sequence], recordings[sequence]
                theirs[label, sequence] = _print_frame(record, method), _count_blocks(record, recording)
    if failures:
        raise BadInput(failures[0].problem, where=f"{streams}: {failures[0].sequence}")
    reused = max(one.reused for one in stores)
    if reused:
        notify(f"{plural(reused, 'recording')} had been evaluated by a run that was stopped")
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
    rows = rank_answers(answers, runs)
    return SafRanking(rows, answers, compare_with_runs(answers, runs), tuple(runs), left_out, own, tuple(broke))


def remove_kept(out: Path) -> None:
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
        found = [admit_method(name) for name in methods]
        return list({method.name: method for method in found}.values()), left_out
    chosen: dict[str, Method] = {}
    for run, records in runs.items():
        for label in dict.fromkeys(record.method for record in records):
            try:
                with refuse_code(run):
                    chosen.setdefault(label, admit_method(label))
            except BadInput as error:
                left_out[label] = error.problem
    if runs and not chosen:
        raise BadInput(f"no method of {', '.join(runs)} is available", hint="name methods: --method or --methods")
    return list(chosen.values()) or [admit_method(name) for name in DEFAULT_RECORDED_METHODS], left_out


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
    stated_options = split_options(halves[1])[1] if len(halves := split_halves(name)) > 1 else ""
    options = [key for key in BLOCK_OPTIONS if key in method.search_options]
    if (
        name.startswith("@")
        or not options
        or any(item.startswith(f"{options[0]}=") for item in stated_options.split(","))
    ):
        return method
    text = f"{name}{',' if stated_options else ':'}{options[0]}={block}"
    with refuse_code("this method"):  # its code is already loaded
        return admit_method(f"{text}@{region}" if region else text)


def _print_frame(record: Record, method: Method) -> float | None:
    """Return the frame that SAF's programs print, counted from 1; for a block, this is its last frame."""
    if record.frame is None:
        return None
    block = method.search_options.get("window", 1) if method.search_name in PRINTS_LAST_FRAME else 1
    return record.frame + 1 + (block - 1) / 2


def _count_blocks(record: Record, recording: SafRecording) -> int | None:
    """Return the number of blocks between answer and truth, as CEN counts them.

    The frame of the truth is counted from 1 here, although blocks are counted from frame 0.
    """
    block = recording.block or 1
    return None if record.frame is None else abs(int(record.frame // block) - (recording.focal_frame + 1) // block)


def rank_answers(answers: Sequence[SafAnswer], runs: Mapping[str, Sequence[Record]]) -> tuple[SafRow, ...]:
    success = [_score_run(records) for records in runs.values()]
    rows = []
    for method, own in group_by(answers, "method").items():
        errors = [a.error for a in own if a.error is not None]
        blocks = [a.blocks for a in own if a.blocks is not None]
        own_errors = [a.own_error for a in own if a.own_error is not None]
        rows.append(
            SafRow(
                0,
                method,
                float(np.mean(list(_mean_by_scene(own, lambda a: a.fraction_off(a.error)).values()))),
                float(np.median(np.abs(errors))) if errors else None,
                float(np.mean(blocks)) if blocks else None,
                float(np.mean([a.error is not None and abs(a.error) <= a.block for a in own])),
                len(own) - len(errors),
                0,
                float(np.mean(list(_mean_by_scene(own, lambda a: a.fraction_off(a.own_error)).values()))),
                float(np.median(np.abs(own_errors))) if own_errors else None,
                tuple(_mean_of_scenes(scores, method) for scores in success),
            )
        )
    ranked = [
        replace(
            row,
            rank=1 + sum(other.off < row.off - 1e-9 for other in rows),
            own_rank=1 + sum(other.own_off < row.own_off - 1e-9 for other in rows),
        )
        for row in rows
    ]
    return tuple(sorted(ranked, key=lambda row: (row.rank, row.method)))


def _mean_by_scene(answers: Sequence[SafAnswer], value: Callable[[SafAnswer], float]) -> dict[str, float]:
    return {scene: float(np.mean([*map(value, own)])) for scene, own in group_by(answers, "scene").items()}


def _mean_of_scenes(scores: Mapping[str, Mapping[str, float]], method: str) -> float | None:
    known = [own[method] for own in scores.values() if method in own]
    return float(np.mean(known)) if known else None


def _score_run(records: Sequence[Record]) -> dict[str, dict[str, float]]:
    """Return the answerable success within 1 depth of focus, by scene and then by method."""
    by_method = group_by(records, "method")
    return _by_scene({method: mean_by_scene(own, right_within()) for method, own in by_method.items()})


def _score_answers(answers: Sequence[SafAnswer], score: Callable[[SafAnswer], float]) -> dict[str, dict[str, float]]:
    """Return the mean score, by scene and then by method."""
    return _by_scene({method: _mean_by_scene(own, score) for method, own in group_by(answers, "method").items()})


def _by_scene(by_method: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    scenes: dict[str, dict[str, float]] = {}
    for method, means in by_method.items():
        for scene, mean in means.items():
            scenes.setdefault(scene, {})[method] = mean
    return scenes


def compare_with_runs(answers: Sequence[SafAnswer], runs: Mapping[str, Sequence[Record]]) -> tuple[RankAgreement, ...]:
    """Return the agreement of the rankings by SAF's protocol and by ours, and of each with every evaluation."""
    named = {
        THEIRS: _score_answers(answers, lambda a: -a.fraction_off(a.error)),
        OURS: _score_answers(answers, lambda a: -a.fraction_off(a.own_error)),
    }
    for run, records in runs.items():  # scenes of other data differ even if their names are the same
        named[run] = {f"{run}: {scene}": scores for scene, scores in _score_run(records).items()}
    ranked = list(named.items())
    pairs = [(first, second) for number, first in enumerate(ranked[:2]) for second in ranked[number + 1 :]]
    found = (compare_scores(first, second, condition="ranking") for first, second in pairs)
    return tuple(one for one in found if one is not None)


def saf_table(ranking: SafRanking) -> Table:
    """Return the table of a ranking; its last columns are of the evaluations of other data, if any."""

    def beside(number: int) -> Column:
        header = f"answerable, within 1 DoF, {ranking.beside[number]}"
        return Column(header, lambda row: row.beside[number], percent, kind="number", detail=1)

    recordings, scenes = len({a.recording for a in ranking.answers}), len({a.scene for a in ranking.answers})
    size = f"{plural(recordings, 'recording')} of {plural(scenes, 'scene')}"
    columns = [*_COLUMNS, *map(beside, range(len(ranking.beside)))]
    return Table(columns, ranking.rows, f"{plural(len(ranking.rows), 'method')} on {size}")


_COLUMNS = (
    Column("rank", "rank", kind="number"),
    Column("method", "method"),
    Column("error, % of recording", lambda row: 100 * row.off, ".2f", kind="number"),
    Column("median, frames", "error_frames", ".1f", kind="number"),
    Column("mean, blocks", "error_blocks", ".1f", kind="number", detail=1),
    Column("within a block", "within_block", percent, kind="number", detail=1),
    Column("no answer", "unanswered", kind="number", detail=1),
    Column("rank, ours", "own_rank", kind="number", detail=1),
    Column("error, % ", lambda row: 100 * row.own_off, ".2f", kind="number", detail=1),
    Column("median, frames ", "own_error_frames", ".1f", kind="number", detail=1),
)


def write_saf(folder: Path, ranking: SafRanking) -> list[Path]:
    """Write ``ranking.json``, ``ranking.md`` and ``answers.csv``; return their paths."""
    document = {
        "format": "saf-gen ranking on SAF's recordings 1",
        "version": __version__,
        "protocol": list(PROTOCOL_NOTES),
        "beside": list(ranking.beside),
        "rows": [asdict(row) for row in ranking.rows],
        "rank_agreement": [asdict(one) for one in ranking.agreement],
        "meanings": AGREEMENT_MEANINGS,
        "left_out": dict(ranking.left_out),
    }
    names = [*(field.name for field in fields(SafAnswer)), "error", "own_error"]
    texts = {
        "ranking.json": json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        "ranking.md": _format_markdown(ranking),
        "answers.csv": Table([Column(name, name) for name in names], ranking.answers).to_csv(),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def _format_markdown(ranking: SafRanking) -> str:
    table = saf_table(ranking)
    names = name_list(row.method for row in ranking.rows)
    parts = [f"# {table.title}\n", table.to_markdown(), *([f"{escape_markdown(names)}\n"] if names else [])]
    parts += [f"{note}\n" for note in PROTOCOL_NOTES]
    if ranking.agreement:
        parts += ["## Agreement of ranks\n", agreement(ranking.agreement).to_markdown()]
    if ranking.left_out:
        lines = (f"- {escape_markdown(name)}: {escape_markdown(why)}\n" for name, why in ranking.left_out.items())
        parts += ["## Not run\n", "".join(lines)]
    return "\n".join(parts)
