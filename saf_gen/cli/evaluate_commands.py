"""The commands ``evaluate`` and ``score``."""

import shlex
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saf_gen.cli._tables import print_leaderboard
from saf_gen.cli._terminal import ClusterAddress, OutFolder, err, out, print_error, progress_bars, terminal_reporter
from saf_gen.cli.command import FINISHED_WORK_IS_KEPT, NOTHING_WRITTEN, Command, Panel
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput, escape_controls, unknown

if TYPE_CHECKING:
    from saf_gen.benchmark.kept_sequences import KeptSequences
    from saf_gen.benchmark.records import Record
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
    from saf_gen.benchmark.tracks.tasks import SequenceSelection

TRACKS = ("recorded", "closed_loop")
Track = Annotated[
    str, typer.Option(help="recorded: methods share one recording; closed_loop: each method commands the lens.")
]
ActuatorName = Annotated[
    str | None, typer.Option(help="Closed loop: actuator, by name or .yaml file (default: voice_coil).")
]
BudgetMs = Annotated[
    float | None, typer.Option(help="Closed loop: budget in milliseconds (default: the recording, or 1 s).")
]
SweepMs = Annotated[float | None, typer.Option(help="Closed loop: milliseconds per sweep (default: half the budget).")]

OperationRate = Annotated[
    float | None,
    typer.Option(
        "--op-rate", help="Closed loop: declared operations that take a second; 0: computing takes none (default: 1e9)."
    ),
]


def evaluate_command(
    source: Annotated[Path, typer.Argument(help="Dataset folder or stream file; or sample, which comes with saf_gen.")],
    *,
    split: Annotated[
        str | None, typer.Option(help="Split to rank, or all of them together (default: test, or the only split).")
    ] = None,
    scene_motion: Annotated[str | None, typer.Option(help="Evaluate only static or only dynamic sequences.")] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            "-m",
            help="MEASURE+SEARCH, options after a colon, a folder with a card, @FILE of a tuned method, or baselines "
            "(the default); repeatable.",
        ),
    ] = None,
    methods: Annotated[
        Path | None, typer.Option(help="File with one method per line, in addition to --method.")
    ] = None,
    predictions: Annotated[
        Path | None,
        typer.Option(help="JSON Lines file of answers computed elsewhere; without --method, only these are judged."),
    ] = None,
    folder: OutFolder = None,
    track: Track = "recorded",
    actuator: ActuatorName = None,
    budget: BudgetMs = None,
    sweep: SweepMs = None,
    op_rate: OperationRate = None,
    region: Annotated[
        str,
        typer.Option(
            help="Where methods look: target (its bounding box), inside (it), frame, both, shifted, half, double or "
            "centre."
        ),
    ] = "target",
    cluster: ClusterAddress = None,
    limit_s: Annotated[
        float, typer.Option(help="Seconds of computing that a method of others may use on a sequence.")
    ] = 60.0,
    limit_gib: Annotated[float, typer.Option(help="Memory in GiB that the process of such a method may use.")] = 2.0,
) -> None:
    """Run focus methods on recordings, rank them, and write tables and a page."""
    from saf_gen.benchmark.admission import admit_method, read_methods
    from saf_gen.benchmark.evaluate import evaluate as run
    from saf_gen.benchmark.guests.host import Limits
    from saf_gen.benchmark.kept_sequences import KeptSequences, kept_folder
    from saf_gen.benchmark.method_spec import BASELINES
    from saf_gen.benchmark.tracks.tasks import select_sequences_to_evaluate
    from saf_gen.core.files import check_on_disk, check_writable, lock_folder
    from saf_gen.leaderboard import Leaderboard
    from saf_gen.leaderboard.ranking import describe_size
    from saf_gen.leaderboard.report import check_replaceable, write_evaluation
    from saf_gen.leaderboard.report.pictures import picture_answers
    from saf_gen.stream.sample_dataset import SAMPLE, find_data, sample

    limits = Limits(run_s=limit_s, resident_bytes=int(limit_gib * 2**30))
    for one in filter(BASELINES.__ne__, method or ()):
        admit_method(one, limits)  # lists and tuned files may name only code that --method names as well
    named = [*(method or ()), *(read_methods(methods, limits) if methods else ())]
    protocol = protocol_from_options(track, actuator=actuator, budget=budget, sweep=sweep, op_rate=op_rate)
    name = "evaluation" if track == "recorded" else "evaluation-closed-loop"
    check_on_disk(source)
    data = find_data(source)
    target = folder or (data / name if data.is_dir() else data.with_name(f"{data.stem}-{name}"))
    if data == sample() and folder is None:
        target = Path(f"{SAMPLE}-{name}")
    check_replaceable(target)
    check_writable(target)
    selection = select_sequences_to_evaluate(data, split=split, scene_motion=scene_motion)
    _print_selection(selection, scene_motion)
    kept = KeptSequences(kept_folder(target))
    with lock_folder(target):
        with progress_bars() as bars:
            result = run(
                data,
                methods=named or None,
                split=split,
                scene_motion=scene_motion,
                region=region,
                protocol=protocol,
                predictions=predictions,
                progress=terminal_reporter("evaluate", bars, parts=len(selection.tasks)),
                keep=kept,
                cluster=cluster,
                limits=limits,
                tell=err.print,
            )
        print_kept(kept, splits={record.what.split for record in result.records})
        board = Leaderboard.of(result)
        delivered = picture_answers(selection.tasks, board)
        written = write_evaluation(target, board, title=data.resolve().name, delivered=delivered)
        kept.remove()
    regions = " and ".join(sorted({record.who.region for record in result.records}, reverse=True))
    title = f"{data}: {describe_size(result.records)}, region {regions}{', closed loop' if protocol else ''}"
    # after writing files, because a pipe that closes early, as with `| head`, ends the program
    words = [text.replace("RECORDING", shlex.quote(str(data))) if data.is_file() else text for text in board.last_words]
    print_leaderboard(replace(board.printed, title=title), last_words=words, written=written)
    for failure in result.failures:
        print_error(f"{failure.sequence} could not be evaluated: {failure.problem}", 1)
    at_work = {r.who.method for r in result.records if not (r.who.limits and r.judgement.status == "failed")}
    broke = [record for record in result.records if record.broke or record.who.method not in at_work]
    print_broken(broke, runs=Counter(record.who.method for record in result.records))
    if result.failures or broke:
        raise typer.Exit(1)


def print_broken(broke: "Sequence[Record]", runs: Mapping[str, int] | None = None) -> None:
    """Print a line on stderr for each method whose code broke in one of its ``runs``."""
    for method, count in Counter(record.who.method for record in broke).items():
        why = next(record.judgement.note for record in broke if record.who.method == method)
        of = f"{count} of {plural(runs[method], 'sequence')}" if runs else plural(count, "run")
        print_error(f"{method} failed on {of}: {why}", 1)


def _print_selection(selection: "SequenceSelection", scene_motion: str | None) -> None:
    """Print which splits are ranked, and how many sequences of others are left out; nothing for a single stream."""
    tasks = selection.tasks
    splits = dict.fromkeys(task.split for task in tasks if task.split is not None)
    if not splits:
        return
    line = ", ".join(filter(None, (name_splits(splits), scene_motion)))
    line += f": {plural(len(tasks), 'sequence')} of {plural(len({task.scene for task in tasks}), 'scene')}"
    if others := Counter(selection.left_out.values()):
        line += f"; left out: {', '.join(f'{count} of {split}' for split, count in others.items())}"
        line += "" if "all" in {*splits, *others} else " (--split all ranks all)"
    if selection.unmade:
        line += f"; {selection.unmade} more are planned and not made yet (the command that made these goes on)"
    with suppress(SystemExit):  # a pipe that is closed already must not end the evaluation
        out.print(escape_controls(line), soft_wrap=True)


def name_splits(splits: Collection[str]) -> str:
    """Return the names of splits after the word split or splits."""
    return escape_controls(f"split{'' if len(splits) == 1 else 's'} {' and '.join(splits)}")


def print_kept(kept: "KeptSequences", *, splits: Collection[str | None]) -> None:
    """Print on stderr how many sequences a run that was stopped had evaluated, of these ``splits`` and of others."""
    stopped = "had been evaluated by a run that was stopped"
    if kept.reused:
        err.print(f"{plural(kept.reused, 'sequence')} {stopped}")
    for split, count in kept.count_left_over().items():
        if split in splits:
            why = "evaluated again, because methods, their files or options, or the data are not what they were"
            err.print(f"{plural(count, 'sequence')} {stopped}; {why}")
        elif split is not None:
            err.print(f"{plural(count, 'sequence')} of {name_splits([split])} {stopped}; not ranked now")


def protocol_from_options(
    track: str, *, actuator: str | None, budget: float | None, sweep: float | None, op_rate: float | None
) -> "ClosedLoopProtocol | None":
    """Return the closed-loop protocol of command options, whose times are in ms, or None for the recorded track.

    An ``op_rate`` of 0 means that computing takes no time, and None the stated rate.
    """
    if track not in TRACKS:
        raise unknown("track", track, allowed=TRACKS)
    if track == "recorded":
        for option, value in (("actuator", actuator), ("budget", budget), ("sweep", sweep), ("op-rate", op_rate)):
            if value is not None:
                raise BadInput(
                    f"--{option} {value} is given for the recorded track",
                    allowed="with --track closed_loop",
                    hint="add --track closed_loop",
                )
        return None
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
    from saf_gen.benchmark.view.operations import OPERATIONS_PER_S
    from saf_gen.optics.actuators import get_actuator

    return ClosedLoopProtocol(
        get_actuator(actuator or "voice_coil"),
        budget_s=None if budget is None else budget / 1e3,
        sweep_s=None if sweep is None else sweep / 1e3,
        operations_per_s=OPERATIONS_PER_S if op_rate is None else op_rate or None,
    )


def score_command(
    stream: Annotated[Path, typer.Argument(help="File of spikes, photons, events or frames.")],
    measure: Annotated[str, typer.Option(help="Focus measure; saf-gen methods lists them.")],
    *,
    window: Annotated[int, typer.Option(min=1, help="Frames per block.")],
    csv: Annotated[Path | None, typer.Option("--out", help="CSV file to write (default: the terminal).")] = None,
    region: Annotated[str, typer.Option(help="Where to look: frame, or target (its bounding box).")] = "frame",
) -> None:
    """Score consecutive blocks of a recording with a measure.

    The output is CSV with the first frame and the score of each block.
    """
    from saf_gen.benchmark.evaluate import score_blocks
    from saf_gen.core.files import write_text
    from saf_gen.stream.recordings import open_recording

    with open_recording(stream) as opened:
        frames, scores = score_blocks(opened, measure, window=window, region=region)
    text = "frame,score\n" + "".join(f"{f},{s!r}\n" for f, s in zip(frames.tolist(), scores.tolist(), strict=True))
    if csv is None:
        out.file.write(text)
        return
    write_text(csv, text)
    out.print(f"{plural(len(frames), 'block')} in {csv}")


COMMANDS = {
    "evaluate": Command(
        evaluate_command,
        (
            "evaluate datasets/quickstart",
            "evaluate quickstart --method baselines --method my.py:sharpness+argmax",
            "evaluate datasets/quickstart --track closed_loop --budget 100",
            "evaluate datasets/quickstart --predictions answers.jsonl",
        ),
        Panel.EVALUATE,
        FINISHED_WORK_IS_KEPT,
    ),
    "score": Command(
        score_command,
        ("score recording.h5 --measure sd --window 100 --out curve.csv",),
        Panel.EVALUATE,
        NOTHING_WRITTEN,
    ),
}
"""The commands of this file, by the words that call them."""
