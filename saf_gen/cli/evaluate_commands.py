"""Commands that judge focus methods: ``evaluate``, ``score``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saf_gen.cli._leaderboard_table import print_leaderboard, print_written_paths
from saf_gen.cli._terminal import OutFolder, make_step_reporter, out, print_error, progress_bars
from saf_gen.errors import BadInput, unknown

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

__all__ = ["build_protocol", "evaluate", "score"]

TRACKS = ("recorded", "closed_loop")


def evaluate(
    source: Annotated[Path, typer.Argument(help="A dataset folder or a stream file.")],
    split: Annotated[str | None, typer.Option(help="Only this split.")] = None,
    scene_motion: Annotated[
        str | None, typer.Option(help="Only static, or only dynamic, sequences of a dataset.")
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(help="MEASURE+SEARCH, options after a colon, @frame at the end; may be given again."),
    ] = None,
    methods: Annotated[
        Path | None, typer.Option(help="A file that names methods, one a line; beside those of --method.")
    ] = None,
    predictions: Annotated[
        Path | None, typer.Option(help="Answers made elsewhere, a line of JSON each, judged beside.")
    ] = None,
    folder: OutFolder = None,
    track: Annotated[
        str,
        typer.Option(help="recorded: all methods see the same sweep; closed_loop: each moves the lens."),
    ] = "recorded",
    actuator: Annotated[
        str | None, typer.Option(help="Of the closed loop: a preset or a .yaml file (voice_coil).")
    ] = None,
    budget: Annotated[
        float | None, typer.Option(help="Of the closed loop: milliseconds (the recording's length).")
    ] = None,
    sweep: Annotated[
        float | None, typer.Option(help="Of the closed loop: milliseconds from end to end (half the budget).")
    ] = None,
    region: Annotated[
        str, typer.Option(help="target (box round the target), frame, or both: each method twice.")
    ] = "target",
) -> None:
    """Run focus methods over recordings, rank them, draw their curves."""
    from saf_gen.benchmark.evaluate import evaluate as run
    from saf_gen.benchmark.method_spec import read_method_list
    from saf_gen.core.files import check_writable
    from saf_gen.leaderboard import rank_methods
    from saf_gen.leaderboard.report import write_evaluation

    named = [*(method or ()), *(read_method_list(methods) if methods else ())]
    protocol = build_protocol(track, actuator, budget, sweep)
    target = folder or _beside(source, track)
    check_writable(target)
    with progress_bars() as bars:
        result = run(
            source,
            methods=named or None,
            split=split,
            scene_motion=scene_motion,
            region=region,
            protocol=protocol,
            predictions=predictions,
            progress=make_step_reporter("evaluate", bars),
        )
    rows = rank_methods(result.records)
    sequences = len({record.sequence for record in result.records})
    looked = " and ".join(sorted({record.region for record in result.records}, reverse=True))
    print_leaderboard(
        rows,
        records=result.records,
        title=f"{source}: {sequences} sequences, region {looked}{', closed loop' if protocol else ''}",
    )
    written = write_evaluation(target, rows=rows, evaluation=result, title=source.resolve().name)
    print_written_paths(written)
    for failure in result.failures:
        print_error(f"{failure.sequence} could not be evaluated: {failure.problem}", 1)
    if result.failures:
        raise typer.Exit(1)


def build_protocol(
    track: str, actuator: str | None, budget: float | None, sweep: float | None
) -> "ClosedLoopProtocol | None":
    """The protocol of the closed loop; None for the recorded track, which has none."""
    if track not in TRACKS:
        raise unknown("track", track, allowed=TRACKS)
    if track == "recorded":
        for option, given in (("actuator", actuator), ("budget", budget), ("sweep", sweep)):
            if given is not None:
                raise BadInput(
                    f"--{option} {given} on a recording", allowed="with --track closed_loop", hint="add it"
                )
        return None
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
    from saf_gen.optics.actuators import get_actuator

    return ClosedLoopProtocol(
        get_actuator(actuator or "voice_coil"),
        budget_s=None if budget is None else budget / 1e3,
        sweep_s=None if sweep is None else sweep / 1e3,
    )


def _beside(source: Path, track: str) -> Path:
    """Where results go unless told: in the dataset's folder, or beside a stream; each track has its own."""
    name = "evaluation" if track == "recorded" else "evaluation-closed-loop"
    return source / name if source.is_dir() else source.with_name(f"{source.stem}-{name}")


def score(
    stream: Annotated[Path, typer.Argument(help="A stream file.")],
    measure: Annotated[str, typer.Option(help="A focus measure; see: saf-gen methods.")],
    window: Annotated[int, typer.Option(min=1, help="Frames a block.")],
    csv: Annotated[Path | None, typer.Option("--out", help="Write here rather than to the terminal.")] = None,
    region: Annotated[str, typer.Option(help="frame, or target (box round the target).")] = "frame",
) -> None:
    """Score consecutive blocks of a stream: columns `frame` (first of the block, from 0) and `score`."""
    from saf_gen.benchmark.evaluate import score_blocks
    from saf_gen.core.files import write_text_atomically
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        frames, scores = score_blocks(opened, measure, window=window, region=region)
    text = "frame,score\n" + "".join(
        f"{f},{s!r}\n" for f, s in zip(frames.tolist(), scores.tolist(), strict=True)
    )
    if csv is None:
        out.file.write(text)
        return
    write_text_atomically(csv, text)
    out.print(f"{len(frames)} blocks in {csv}")
