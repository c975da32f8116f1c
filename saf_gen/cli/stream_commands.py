"""The commands ``import``, ``encode``, ``export``, ``cut``, ``inspect``, ``view`` and ``dataset index``."""

import re
import shlex
from collections import Counter
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from saf_gen.cli._tables import print_facts, print_json
from saf_gen.cli._terminal import AsJson, Linear, Transfer, err, out
from saf_gen.cli.command import NOTHING_WRITTEN, Command, Panel
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput, escape_controls, some_of, unknown

if TYPE_CHECKING:
    from saf_gen.stream.interop import Readouts, Source
    from saf_gen.stream.recordings import Recording

SHADES = " .:-=+*#%@"
PICTURE_COLUMNS, PICTURE_FRAMES = 48, 200
SMALL_COLUMNS = 32
"""Columns of a picture that is one of several."""
ANSWER = "answer"
BIT_NAMES = {"lsb": "least significant", "msb": "most significant"}
Size = Annotated[str | None, typer.Option(help="Columns x rows of raw frames without gaps: 600x400.")]
Bits = Annotated[str | None, typer.Option("--bits", help="First value in a byte: lsb or msb.")]
Rate = Annotated[float, typer.Option(help="Readouts per second.")]
Key = Annotated[str | None, typer.Option(help="Array of a .npz or .mat file, or layer of OpenEXR.")]
FocusLog = Annotated[Path | None, typer.Option(help="Lens log: CSV of frame,position or seconds,position.")]
TruthText = Annotated[str | None, typer.Option(help="True focus: position 0.42 or frame:812.")]
DepthOfFocus = Annotated[
    tuple[float, float] | None, typer.Option(metavar="<a> <b>", help="Near and far positions where it is sharp.")
]


def import_command(
    file: Annotated[Path, typer.Argument(help="Raw frames, .npy, .npz, .mat, or a folder of SAF.")],
    target: Annotated[Path, typer.Option("--out", help="Stream file, or folder for a folder.")],
    *,
    layout: Annotated[str | None, typer.Option(help="Raw frames: 416, dense or sps1000.")] = None,
    size: Size = None,
    order: Bits = None,
    axes: Annotated[str | None, typer.Option(help="Order of time, rows, columns in an array: TYX, YXT.")] = None,
    kind: Annotated[str, typer.Option(help="What a 1 is: spikes or photons.")] = "spikes",
    frames: Annotated[int | None, typer.Option(help="Frames to import (default: all).")] = None,
    rate: Rate = 20_000.0,
    flip: Annotated[bool | None, typer.Option(help="Bottom row first, or top.")] = None,
    key: Key = None,
    focus: FocusLog = None,
    light: Annotated[Path | None, typer.Option(help="Light log: CSV of seconds,NAME, a column a light.")] = None,
    truth: TruthText = None,
    depth_of_focus: DepthOfFocus = None,
    mask: Annotated[str | None, typer.Option(help="Bad pixels: a picture, an array, or CSV of row,column.")] = None,
    times: Annotated[Path | None, typer.Option(help="CSV of seconds or readout, a row a frame.")] = None,
) -> None:
    """Convert a recording of another program to a stream.

    Its lens log, light log and true focus are stored with it, if they are given.
    """
    from saf_gen.camera.kinds import kinds_of_cameras
    from saf_gen.stream import interop

    if file.is_dir():
        options: dict[str, object] = {"--layout": layout, "--size": size, "--bits": order, "--axes": axes}
        options |= {"--kind": kind != "spikes", "--frames": frames, "--flip": flip is not None, "--key": key}
        options |= {"--focus": focus, "--light": light, "--truth": truth, "--depth-of-focus": depth_of_focus}
        options |= {"--mask": mask, "--times": times}
        _import_saf_folder(file, target, rate=rate, refused=[name for name, value in options.items() if value])
        return
    _check_stream_output(file, target)
    if kind not in (known := kinds_of_cameras("bits")):
        raise unknown("kind of recording", kind, allowed=known)
    source, how = _open_source(
        file, layout=layout, size=parse_size(size), order=order, axes=axes, frames=frames, flip=flip, key=key
    )
    count, *shape = source.shape
    bad = None if mask is None else interop.read_mask(mask, (shape[0], shape[1]))
    readouts = None
    if times is not None:
        readouts = interop.read_times(times, frames=count, total=source.total, readout_hz=rate)
    fields = _read_lens_log_and_truth(
        count, rate=rate, focus=focus, truth=truth, depth_of_focus=depth_of_focus, readouts=readouts
    )
    fields |= _read_light(light, count, rate=rate, readouts=readouts)
    if readouts is not None:
        fields |= {"kept": readouts.kept, "readout": readouts.of_gaps}
    is_masked = bad is not None and bool(bad.any())
    digest = interop.write_source(source, target, readout_hz=rate, kind=kind, mask=bad if is_masked else None, **fields)
    _print_written_stream(target, f"{kind} read as {how}, sha256 {digest[:16]}")
    if bad is not None:
        number = plural(int(np.count_nonzero(bad)), "bad pixel")
        out.print(f"mask: {f'{number}, filled in counts and pictures' if is_masked else 'no bad pixel'}")
    for line in () if readouts is None else readouts.describe():
        out.print(line, soft_wrap=True)
    if focus is not None:
        line, is_odd = interop.describe_coverage(focus, frames=count, readout_hz=rate, readouts=readouts)
        (err if is_odd else out).print(f"{'Warning: ' if is_odd else ''}lens log {focus}: {line}", soft_wrap=True)
    _print_picture(source, columns=PICTURE_COLUMNS)


def _check_stream_output(source: Path, target: Path) -> None:
    """Raise BadInput if the output is the source, a link, or a file that is no stream."""
    from saf_gen.core.files import check_apart
    from saf_gen.stream.stream_file import check_replaceable

    check_apart(source, target)
    check_replaceable(target)


def _open_source(
    file: Path,
    *,
    layout: str | None,
    size: tuple[int, int] | None,
    order: str | None,
    axes: str | None,
    frames: int | None,
    flip: bool | None,
    key: str | None,
) -> "tuple[Source, str]":
    """Return a recording of another program, and how it is read in words."""
    from saf_gen.stream import interop

    if file.suffix.lower() in interop.ARRAY_ENDINGS:
        for name, value in (("layout", layout), ("size", size)):
            if value is not None:
                problem, allowed = f"--{name} is given for an array", "with raw frames"
                hint = "state --axes, and --bits if a byte holds eight frames"
                raise BadInput(problem, where=str(file), allowed=allowed, hint=hint)
        array = interop.SpikeArray(file, key=key, axes=axes, order=order, frames=frames, flip=bool(flip))
        packing = f", eight frames per byte, {BIT_NAMES[order]} bit first" if order else ""
        return array, f"an array with axes {axes}{packing}"
    if key is not None:
        raise BadInput(f"--key {key} is given for a raw file", where=str(file), allowed="with .npz and .mat files")
    if axes is not None:
        raise BadInput(f"--axes {axes} is given for a raw file", where=str(file), allowed="with arrays")
    if layout is None and size is None:
        for named in interop.fitting_layouts(file):
            out.print(f"{file} as --layout {named.name}:", markup=False, soft_wrap=True)
            _print_picture(interop.RawFrames(file, named, flip=flip), columns=SMALL_COLUMNS)
    kind, first = interop.state_layout(file, layout=layout, size=size, order=order)
    raw = interop.RawFrames(file, kind, order=first, frames=frames, flip=flip)
    upside = "bottom" if raw.origin["flip"] else "top"
    return raw, f"layout {kind.name}, {BIT_NAMES[first]} bit first, {upside} row first"


def _import_saf_folder(folder: Path, target: Path, *, rate: float, refused: list[str]) -> None:
    from saf_gen.core.files import refuse_link
    from saf_gen.stream.interop.saf_folder import import_saf_folder

    refuse_link(target)
    if refused:
        raise BadInput(
            f"{refused[0]} is given with a folder", allowed="--rate", hint="leave it out: config.xlsx has the rest"
        )
    made = 0
    for path in import_saf_folder(folder, target, readout_hz=rate):
        made += 1
        _print_written_stream(path, "read as layout 416")
    err.print("config.xlsx has no lens positions: the lens is assumed to move evenly from 0 to 1")
    out.print(f"{plural(made, 'recording')}; next: saf-gen dataset index {shlex.quote(str(target))}")


def _print_written_stream(stream: Path, how: str) -> None:
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        count, rows, columns = opened.shape
    out.print(f"{plural(count, 'frame')} of {columns}×{rows} in {stream}, {how}")


def _read_lens_log_and_truth(
    frames: int,
    *,
    rate: float,
    focus: Path | None,
    truth: str | None,
    depth_of_focus: tuple[float, float] | None,
    lens: np.ndarray | None = None,
    readouts: "Readouts | None" = None,
) -> dict[str, Any]:
    """Return the fields of a stream that follow from a lens log, or from its positions ``lens``, and a true focus."""
    from saf_gen.stream.interop import import_lens_log, truth_from_text

    fields: dict[str, Any] = {"focus_position": lens}
    if focus is not None:
        fields["focus_position"] = import_lens_log(focus, frames=frames, readout_hz=rate, readouts=readouts)
    if truth is not None:
        lens = fields.get("focus_position")
        fields["truth"] = truth_from_text(truth, focus_position=lens, depth_of_focus=depth_of_focus, readouts=readouts)
    elif depth_of_focus is not None:
        raise BadInput("--depth-of-focus is given without --truth", hint="add the position of best focus")
    return fields


def _read_light(light: Path | None, frames: int, *, rate: float, readouts: "Readouts | None") -> dict[str, Any]:
    from saf_gen.stream.interop import import_light_log

    if light is None:
        return {}
    gains = import_light_log(light, frames=frames, readout_hz=rate, readouts=readouts)
    return {"gain": np.stack(list(gains.values()), axis=1), "light_names": tuple(gains)}


def parse_size(text: str | None) -> tuple[int, int] | None:
    """Return rows and columns of a size such as 400x250 (columns by rows); raise BadInput if it is not one."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d+)\s*[x×X,*]\s*(\d+)\s*", text)
    if match is None or 0 in (found := (int(match[2]), int(match[1]))):
        raise BadInput(f"the size is {text!r}", allowed="columns and rows, such as 400x250")
    return found


def _print_picture(source: "Source", *, columns: int) -> None:
    """Print the counts of some frames in the middle of a recording, so that a wrong size or order is seen at once."""
    total = source.shape[0]
    first = max((total - PICTURE_FRAMES) // 2, 0) // 8 * 8
    counts = np.bitwise_count(source.packed(first, min(first + PICTURE_FRAMES, total))).sum(axis=2, dtype=float)
    rows, wide = counts.shape[0], min(columns, counts.shape[1])
    high = max(min(round(wide * rows / counts.shape[1] / 2), rows, columns), 1)  # a character is twice as high as wide
    for axis, cells in ((0, high), (1, wide)):
        edges = np.linspace(0, counts.shape[axis], cells + 1).round().astype(int)
        sizes = np.diff(edges).reshape((-1, 1) if axis == 0 else (1, -1))
        counts = np.add.reduceat(counts, edges[:-1], axis=axis) / sizes
    low, peak = np.percentile(counts, (1, 99))
    level = np.clip((counts - low) / max(peak - low, 1e-9), 0, 1) * (len(SHADES) - 1)
    out.print("\n".join("".join(SHADES[int(value + 0.5)] for value in line) for line in level), markup=False)


def encode_command(
    pictures: Annotated[
        Path, typer.Argument(help="Folder of images or OpenEXR files, a video, or a .npy, .npz or .mat file.")
    ],
    target: Annotated[Path, typer.Option("--out", help="Stream file to write.")],
    *,
    rate: Annotated[
        str | None,
        typer.Option(help="Pictures per second, such as 240 or 24000/1001 (default: the times of the file)."),
    ] = None,
    transfer: Transfer = None,
    linear: Linear = False,
    sensor: Annotated[str, typer.Option(help="Sensor, by name or file; its array gets the size of the pictures.")] = (
        "vidar_400x250"
    ),
    mean_rate: Annotated[float, typer.Option(help="Spikes per pixel and readout of the mean picture.")] = 0.2,
    frames: Annotated[
        int | None, typer.Option(min=1, help="Number of readouts (default: up to the last picture).")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the device and its noise.")] = 0,
    key: Key = None,
    focus: FocusLog = None,
    truth: TruthText = None,
    depth_of_focus: DepthOfFocus = None,
) -> None:
    """Turn pictures into spikes with the model of a sensor.

    Light cross-fades from each picture to the next.
    """
    from saf_gen.camera import get_sensor
    from saf_gen.stream.interop.encode_pictures import SLOW_READOUTS, encode_pictures, prepare_pictures, rate_from_text
    from saf_gen.stream.interop.picture_frames import open_pictures

    _check_stream_output(pictures, target)
    rate_hz = None if rate is None else rate_from_text(rate)
    source = open_pictures(pictures, linear=linear, transfer=transfer, key=key)
    plan = prepare_pictures(source, get_sensor(sensor), rate_hz=rate_hz, mean_rate=mean_rate, frames=frames)
    hz = plan.sensor.readout_hz
    lens = None if focus is not None else plan.focus_position
    fields = _read_lens_log_and_truth(
        plan.frames, rate=hz, focus=focus, truth=truth, depth_of_focus=depth_of_focus, lens=lens
    )
    if plan.count > 1 and plan.readouts_per_picture > SLOW_READOUTS:
        err.print(
            f"{plan.readouts_per_picture:.0f} readouts per picture: moving objects fade from one position to the next, "
            "and a focus between two pictures is a mixture of both, not physics"
        )
    encode_pictures(plan, target, seed=seed, **fields)
    for note in plan.notes:
        err.print(escape_controls(note), soft_wrap=True, markup=False)
    _print_written_stream(target, f"from {plural(plan.count, 'picture')} {plan.pace}, {source.transfer.name}")
    if source.order:
        out.print(f"in this order: {source.order}", soft_wrap=True, markup=False)
    if source.positions is not None:
        use = "left out, for --focus" if focus is not None else "stored as 0 to 1 of the travel of the lens"
        out.print(f"focus at {source.positions}, {use}", soft_wrap=True, markup=False)


def export_command(
    stream: Annotated[Path, typer.Argument(help="Stream file, or with --for saf a dataset folder or its name.")],
    target: Annotated[Path, typer.Option("--out", help="Raw file to write, or folder for a dataset.")],
    *,
    layout: Annotated[
        str | None, typer.Option(help="Layout of the file: 416, dense or sps1000 (default: by the size of the array).")
    ] = None,
    reader: Annotated[
        str | None, typer.Option("--for", help="Software that will read the file: spikecv, spike-zoo, saf or rsir.")
    ] = None,
    order: Bits = None,
    flip: Annotated[bool | None, typer.Option(help="Store the bottom row first (default: as in the layout).")] = None,
    dt: Annotated[int | None, typer.Option(help="Frames per block, in the list of a folder (default: 100).")] = None,
) -> None:
    """Convert a stream to a raw spike file, or a dataset to a folder of them."""
    from saf_gen.core.files import check_apart, refuse_link
    from saf_gen.stream.interop import READERS, export_raw_frames
    from saf_gen.stream.sample_dataset import find_data
    from saf_gen.stream.stream_file import open_stream

    stream = find_data(stream)
    check_apart(stream, target)
    refuse_link(target)
    if stream.is_dir():
        refused = {"--layout": layout, "--bits": order, "--flip": flip, f"--for {reader}": reader != "saf" or None}
        for option, value in refused.items():
            if value is not None:
                what = "no --for" if reader is None and option.startswith("--for") else option
                raise BadInput(f"{what} is given with a folder", allowed="--for saf, and --dt")
        _export_saf_folder(stream, target, dt=100 if dt is None else dt)
        return
    if dt is not None:
        raise BadInput(f"--dt {dt} is given with a stream", allowed="with a dataset folder and --for saf")
    if target.exists():
        hint = "choose another name, or remove it"
        raise BadInput(f"{target} exists, and raw files do not say who wrote them", hint=hint)
    if reader is not None and layout is not None:
        raise BadInput(
            "--layout and --for are both given", hint="keep one: --for selects the layout that the reader expects"
        )
    if reader is not None and reader not in READERS:
        raise unknown("reader", reader, allowed=READERS)
    if layout is None:
        with open_stream(stream) as opened:
            layout = READERS[reader] if reader else "sps1000" if opened.shape[1:] == (1000, 1000) else "dense"
    count = export_raw_frames(stream, target, layout=layout, order=order or "lsb", flip=flip)
    out.print(f"{plural(count, 'byte')} in {target}, layout {layout}")
    with open_stream(stream) as opened:
        held = opened.metadata
    lost = [
        name
        for name, value in (("mask of bad pixels", held.mask), ("lost readouts", held.readout))
        if value is not None
    ]
    if held.kind != "spikes":
        err.print(f"a raw file cannot say that it holds {held.kind}: saf-gen import FILE --kind {held.kind} states it")
    if lost:
        err.print(
            f"a raw file cannot hold what the stream says of its {' and '.join(lost)}: it has the recorded frames"
        )


def _export_saf_folder(dataset: Path, folder: Path, *, dt: int) -> None:
    from saf_gen.stream.interop.saf_folder import UNEVEN, export_saf_folder

    count, uneven = export_saf_folder(dataset, folder, dt=dt)
    out.print(f"{plural(count, 'recording')} and config.xlsx in {folder}", soft_wrap=True)
    if uneven:
        err.print(escape_controls(f"{UNEVEN}, as the list notes: {some_of(uneven)}"))
    err.print("config.xlsx has no lens positions, light, target or depth of focus")


def cut_command(
    stream: Annotated[Path, typer.Argument(help="Stream file.")],
    target: Annotated[Path, typer.Option("--out", help="Stream file to write.")],
    *,
    first: Annotated[int, typer.Option("--from", min=0, help="First frame.")] = 0,
    stop: Annotated[int | None, typer.Option("--to", min=1, help="Frame after the last one (default: all).")] = None,
    rows: Annotated[str | None, typer.Option(help="Rows to keep, such as 50:200 (default: all).")] = None,
    columns: Annotated[str | None, typer.Option(help="Columns to keep, such as 0:400 (default: all).")] = None,
) -> None:
    """Keep some frames, rows and columns of a stream.

    Its lens, light and truth are kept with them.
    """
    from saf_gen.stream.cutting import cut_stream
    from saf_gen.stream.stream_file import open_stream

    _check_stream_output(stream, target)
    with open_stream(stream) as opened:
        _, height, width = opened.shape
    region = (_parse_span(rows, "rows", total=height), _parse_span(columns, "columns", total=width))
    digest = cut_stream(stream, target, first=first, stop=stop, region=region)
    _print_written_stream(target, f"cut from {stream}, sha256 {digest[:16]}")


def _parse_span(text: str | None, what: str, *, total: int) -> slice:
    match = re.fullmatch(r"\s*(\d*)\s*:\s*(\d*)\s*", ":" if text is None else text)
    first, stop = (0, 0) if match is None else (int(match[1] or 0), int(match[2] or total))
    if not 0 <= first < stop <= total:
        raise BadInput(f"the {what} are {text!r}", allowed=f"FIRST:STOP with 0 <= FIRST < STOP <= {total}")
    return slice(first, stop)


def index_command(
    folder: Annotated[
        Path, typer.Argument(help="Folder with recordings (.h5), or with a folder of recordings per split.")
    ],
    *,
    split: Annotated[str, typer.Option(help="Split of the recordings that are directly in the folder.")] = "test",
) -> None:
    """Write a manifest for a folder of recordings, which makes it a dataset for `saf-gen evaluate`.

    A recording's name, SCENE-LIGHT-NUMBER, tells its scene and light.
    """
    from saf_gen.stream.dataset import UNNAMED_LIGHT, index_folder, is_hidden
    from saf_gen.stream.recordings import METHODS_OF, open_recording
    from saf_gen.stream.sharing.fetching import is_plain_path

    names = {file.relative_to(folder).as_posix(): is_hidden(file, folder) for file in sorted(folder.rglob("*.h5"))}
    if hidden := [name for name, is_left_out in names.items() if is_left_out]:
        err.print(escape_controls(f"left out, because hidden: {some_of(hidden)}"), soft_wrap=True)
    if unsafe := [name for name, is_left_out in names.items() if not (is_left_out or is_plain_path(name))]:
        told = f"names that some systems cannot hold; rename them before you publish: {some_of(unsafe)}"
        err.print(escape_controls(told), soft_wrap=True)
    manifest = index_folder(folder, split=split)
    unlit = [entry.file for entry in manifest.sequences if entry.light == UNNAMED_LIGHT]
    if unlit and len(manifest.sequences) > 1:
        told = f"names that tell no light, as desk-sun-01.h5 does; each is a scene of its own: {some_of(unlit)}"
        err.print(escape_controls(told), soft_wrap=True)
    in_splits = {(entry.scene, entry.split) for entry in manifest.sequences}
    if both := [scene for scene, count in Counter(scene for scene, _ in in_splits).items() if count > 1]:
        err.print(escape_controls(f"scenes that are in several splits: {some_of(both)}"), soft_wrap=True)
    splits = f"split{'' if len(manifest.splits) == 1 else 's'} {', '.join(manifest.splits)}"
    size = f"{plural(len(manifest.sequences), 'sequence')} in {splits}"
    with open_recording(folder / manifest.sequences[0].file) as first:
        command = f"{manifest.next_command(folder)} {METHODS_OF.get(first.form, '')}".rstrip()
    out.print(f"{size}; next: {command}", soft_wrap=True)


def inspect_command(stream: Annotated[Path, typer.Argument(help="Stream file.")], *, as_json: AsJson = False) -> None:
    """Describe what a stream holds and how it was made.

    This is its length, rates, light, lens and true focus.
    """
    from saf_gen.stream import description
    from saf_gen.stream.event_file import has_events, open_events
    from saf_gen.stream.frame_file import has_frames, open_frames
    from saf_gen.stream.stream_file import open_stream

    opener: Any = open_stream
    describe: Any = description.describe_content
    if has_events(stream):
        opener, describe = open_events, description.describe_events
    elif has_frames(stream):
        opener, describe = open_frames, description.describe_frames
    with opener(stream) as opened:
        if as_json:
            print_json(description.describe_in_numbers(opened))
            return
        print_facts(describe(opened), title=str(opened.path))
        out.print()
        print_facts(description.describe_provenance(opened), title="how it was made")


def view_command(
    stream: Annotated[Path, typer.Argument(help="File of spikes, photons, events or frames.")],
    target: Annotated[Path, typer.Option("--out", help="File to write: .png, .svg, .gif or .html.")],
    *,
    kind: Annotated[
        str,
        typer.Option("--as", help="tfp (sum of a window) or, of spikes, tfi (from intervals) or spikes (one readout)."),
    ] = "tfp",
    window: Annotated[
        int | None,
        typer.Option(
            min=1, help="Frames per window (default: 100, a tenth of a short view, or one of a frame camera)."
        ),
    ] = None,
    first: Annotated[int, typer.Option("--from", min=0, help="First frame of the view.")] = 0,
    stop: Annotated[int | None, typer.Option("--to", min=1, help="Frame after the last one (default: all).")] = None,
    every: Annotated[
        int | None, typer.Option(min=1, help="Frames from one picture to the next (default: evenly spaced).")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            help="truth; a position of the lens, 0 to 1; or answer: where measures agree, or both places, by the "
            "evaluation that lies beside it."
        ),
    ] = None,
    measure: Annotated[list[str] | None, typer.Option(help="Focus measure whose curve is drawn; repeatable.")] = None,
    region: Annotated[str, typer.Option(help="Where measures look: target (its box is drawn) or frame.")] = "target",
    fps: Annotated[float, typer.Option(help="Pictures per second of .gif and .html.")] = 12.0,
) -> None:
    """Draw pictures of a recording.

    Its lens position, light, truth and scores are drawn beside them.
    """
    from saf_gen.benchmark.admission import admit_measure
    from saf_gen.benchmark.suitability import measure_misfit
    from saf_gen.stream.pictures import write_view
    from saf_gen.stream.recordings import open_recording

    if at is not None and (first or stop or every):
        raise BadInput("--at is given with --from, --to or --every", hint="leave them out: --at says which frames")
    with open_recording(stream) as opened:
        agreement, frames = None, list[float]()
        if at == ANSWER:
            from saf_gen.leaderboard.agreement import read_agreement

            agreement = read_agreement(stream, opened.content_sha256)
            frames = [place.frame for place in agreement.places]
        elif at is not None:
            frames = [_frame_at(at, opened)]
        for name in measure or ():
            if misfit := measure_misfit(name, opened.counted, form=opened.form):
                raise misfit
        pictures = write_view(
            opened,
            target,
            kind=kind,
            window=window,
            first=first,
            stop=stop,
            every=every,
            at=frames,
            measures=measure or (),
            find_measure=admit_measure,
            region=region,
            fps=fps,
        )
    size = f"{plural(len(pictures.starts), 'picture')} of {plural(pictures.window, 'frame')}"
    out.print(f"{size}{'' if len(pictures.starts) == 1 else ' each'} in {target}")
    if agreement:
        out.print(agreement.describe(), soft_wrap=True)


def _frame_at(place: str, recording: "Recording") -> float:
    """Return the frame of the truth, or the first at which the lens is nearest to a position, 0 to 1."""
    truth, lens = recording.truth, recording.metadata.lens_position
    if place == "truth":
        if not isfinite(truth.frame):
            problem = "the lens never passes the true focus" if truth.known else "no true focus is known"
            raise BadInput(f"--at truth: {problem}", where=str(recording.path), allowed="answer, or a position, 0 to 1")
        return truth.frame
    try:
        position = float(place)
    except ValueError:
        position = -1.0
    if not 0 <= position <= 1:
        allowed = f"{ANSWER}, truth, or a position of the lens, 0 to 1"
        raise BadInput(f"--at is {place!r}", allowed=allowed, hint="--from and --to state frames")
    if lens is None:
        raise BadInput("--at is a position", where=str(recording.path), hint="it has no log of the lens: use --from")
    return float(np.abs(lens - position).argmin())


COMMANDS = {
    "import": Command(
        import_command,
        (
            "import camera.dat --layout dense --out recording.h5 --focus lens.csv",
            "import spikes.mat --axes YXT --out recording.h5 --key spk",
            "import camera.raw --out recording.h5 --size 600x400 --bits msb",
        ),
        Panel.RECORDINGS,
        NOTHING_WRITTEN,
    ),
    "export": Command(
        export_command,
        ("export recording.h5 --out frames.dat --for spikecv", "export datasets/sad_core --out saf/datasets --for saf"),
        Panel.RECORDINGS,
        NOTHING_WRITTEN,
    ),
    "encode": Command(
        encode_command,
        (
            "encode frames --out recording.h5 --rate 1000 --transfer srgb",
            "encode frames.npy --out recording.h5 --rate 640 --linear --truth 0.42",
        ),
        Panel.RECORDINGS,
        NOTHING_WRITTEN,
    ),
    "cut": Command(
        cut_command,
        (
            "cut recording.h5 --from 2000 --to 12000 --out part.h5",
            "cut recording.h5 --rows 50:200 --columns :300 --out part.h5",
        ),
        Panel.RECORDINGS,
        NOTHING_WRITTEN,
    ),
    "view": Command(
        view_command,
        (
            "view recording.h5 --out sweep.png --measure sd",
            "view recording.h5 --out sweep.html --as tfi --window 200",
            "view recording.h5 --out answer.png --at answer",
        ),
        Panel.RECORDINGS,
        NOTHING_WRITTEN,
    ),
    "inspect": Command(inspect_command, ("inspect recording.h5", "inspect recording.h5 --json"), Panel.RECORDINGS),
    "dataset index": Command(index_command, ("dataset index recordings",), Panel.RECORDINGS),
}
"""The commands of this file, by the words that call them."""
