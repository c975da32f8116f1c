"""The commands ``import``, ``encode``, ``export``, ``inspect`` and ``dataset index``."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import AsJson, err, out
from saf_gen.errors import BadInput, unknown

Rate = Annotated[float, typer.Option(help="Readouts per second; such files do not record it.")]
Key = Annotated[str | None, typer.Option(help="Name of the array, where a .npz or .mat file has several.")]
FocusLog = Annotated[
    Path | None, typer.Option(help="Lens log: CSV with frame,position or seconds,position (0 to 1 of the travel).")
]
TruthText = Annotated[
    str | None, typer.Option(help="True focus: a position (0.42), or a frame of the lens log (frame:812).")
]
DepthOfFocus = Annotated[
    tuple[float, float] | None, typer.Option(help="Positions, near and far, between which the target is sharp.")
]


def import_command(
    file: Annotated[Path, typer.Argument(help="Raw frames, a .npy, .npz or .mat file, or SAF's folder of recordings.")],
    target: Annotated[Path, typer.Option("--out", help="Stream file to write; of a folder the folder to write.")],
    *,
    layout: Annotated[
        str, typer.Option(help="Raw: 416, dense, sps1000. Arrays: frames, packed (eight to a byte). Or auto.")
    ] = "auto",
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames to import (default: all).")] = None,
    rate: Rate = 20_000.0,
    flip: Annotated[bool | None, typer.Option(help="Rows are stored bottom first (default: as in the layout).")] = None,
    key: Key = None,
    focus: FocusLog = None,
    light: Annotated[
        Path | None, typer.Option(help="Light log: CSV with frame,NAME or seconds,NAME, a column per light.")
    ] = None,
    truth: TruthText = None,
    depth_of_focus: DepthOfFocus = None,
) -> None:
    """Convert a recording of another program to a stream, with what is known of its lens and focus."""
    from saf_gen.stream import interop

    if file.is_dir():
        given = {"--layout": layout != "auto", "--frames": frames, "--flip": flip is not None, "--key": key,
                 "--focus": focus, "--light": light, "--truth": truth, "--depth-of-focus": depth_of_focus}  # fmt: skip
        _import_saf_folder(file, target, rate=rate, refused=[name for name, value in given.items() if value])
        return
    if file.suffix.lower() in interop.ARRAY_ENDINGS:
        named = None if layout == "auto" else layout
        array = interop.SpikeArray(file, key=key, layout=named, frames=frames, flip=bool(flip))
        known = _read_known(array.shape[0], rate=rate, focus=focus, truth=truth, depth_of_focus=depth_of_focus)
        known |= _read_light(light, array.shape[0], rate=rate)
        digest, kind = array.write(target, readout_hz=rate, **known), array.layout
    else:
        if key is not None:
            raise BadInput(f"--key {key} of a raw file", where=str(file), allowed="with .npz and .mat files")
        looks = _looks_like(file)
        kind = (looks or interop.sniff_imported_layout(file)) if layout == "auto" else layout
        count = interop.count_raw_frames(file, kind, frames=frames)
        known = _read_known(count, rate=rate, focus=focus, truth=truth, depth_of_focus=depth_of_focus)
        known |= _read_light(light, count, rate=rate)
        if looks not in (None, kind):
            err.print(f"{file} looks like layout {looks}, and is read as {kind}")
        digest = interop.import_raw_frames(
            file, target, layout=kind, frames=frames, readout_hz=rate, flip=flip, **known
        )
    _print_made(target, f"read as layout {kind}, sha256 {digest[:16]}")


def _import_saf_folder(folder: Path, target: Path, *, rate: float, refused: list[str]) -> None:
    from saf_gen.stream.interop.saf_folder import import_saf_folder

    if refused:
        raise BadInput(f"{refused[0]} is given with a folder", allowed="--rate", hint="its config.xlsx says the rest")
    made = 0
    for path in import_saf_folder(folder, target, readout_hz=rate):
        made += 1
        _print_made(path, "read as layout 416")
    err.print("config.xlsx does not say where the lens was: it is taken to move evenly from 0 to 1")
    out.print(f"{made} recordings: saf-gen dataset index {target}")


def _print_made(stream: Path, how: str) -> None:
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        count, rows, columns = opened.shape
    out.print(f"{count} frames of {columns}×{rows} in {stream}, {how}")


def _read_known(
    frames: int, *, rate: float, focus: Path | None, truth: str | None, depth_of_focus: tuple[float, float] | None
) -> dict[str, Any]:
    """Return the fields of a stream that a lens log and a truth give."""
    from saf_gen.stream.interop import import_lens_log, import_truth_from_text

    known: dict[str, Any] = {}
    if focus is not None:
        known["focus_position"] = import_lens_log(focus, frames=frames, readout_hz=rate)
    if truth is not None:
        lens = known.get("focus_position")
        known["truth"] = import_truth_from_text(truth, focus_position=lens, depth_of_focus=depth_of_focus)
    elif depth_of_focus is not None:
        raise BadInput("--depth-of-focus is given without --truth", hint="add the position of best focus")
    return known


def _read_light(light: Path | None, frames: int, *, rate: float) -> dict[str, Any]:
    from saf_gen.stream.interop import import_light_log

    if light is None:
        return {}
    gains = import_light_log(light, frames=frames, readout_hz=rate)
    return {"gain": np.stack(list(gains.values()), axis=1), "light_names": tuple(gains)}


def _looks_like(file: Path) -> str | None:
    """Return the layout that a file seems to have; None where it cannot be told, or the import says what is wrong."""
    from saf_gen.stream.interop import sniff_imported_layout

    try:
        return sniff_imported_layout(file)
    except BadInput:
        return None


def encode_command(
    pictures: Annotated[Path, typer.Argument(help="Folder of images, a video, or a .npy, .npz or .mat file.")],
    target: Annotated[Path, typer.Option("--out", help="Stream file to write.")],
    *,
    rate: Annotated[float | None, typer.Option(help="Pictures per second (default: as the video says).")] = None,
    linear: Annotated[bool, typer.Option("--linear", help="Values are linear light; else they are sRGB.")] = False,
    sensor: Annotated[str, typer.Option(help="Sensor by name or file; its array gets the pictures' size.")] = (
        "vidar_400x250"
    ),
    mean_rate: Annotated[float, typer.Option(help="Spikes per pixel and readout of the mean picture.")] = 0.2,
    frames: Annotated[int | None, typer.Option(min=1, help="Readouts (default: up to the last picture).")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the device and its noise.")] = 0,
    key: Key = None,
    focus: FocusLog = None,
    truth: TruthText = None,
    depth_of_focus: DepthOfFocus = None,
) -> None:
    """Turn pictures into spikes by the model of the sensor; between two pictures light is a cross-fade of both."""
    from saf_gen.camera import get_sensor
    from saf_gen.stream.interop.encode_pictures import SLOW, encode_pictures_as_stream, prepare_stream_of_pictures
    from saf_gen.stream.interop.picture_frames import open_imported_pictures

    source = open_imported_pictures(pictures, linear=linear, key=key)
    plan = prepare_stream_of_pictures(source, get_sensor(sensor), rate_hz=rate, mean_rate=mean_rate, frames=frames)
    hz = plan.sensor.readout_hz
    known = _read_known(plan.frames, rate=hz, focus=focus, truth=truth, depth_of_focus=depth_of_focus)
    if plan.count > 1 and plan.readouts_per_picture > SLOW:
        err.print(
            f"{plan.readouts_per_picture:.0f} readouts to a picture: what moves is faded from one place to the next, "
            "and a focus between two is a mix of both, not physics"
        )
    encode_pictures_as_stream(plan, target, seed=seed, **known)
    values = "linear light" if linear else "sRGB decoded"
    _print_made(target, f"from {plan.count} pictures at {plan.rate_hz:g} Hz, {values}")


def export_command(
    stream: Annotated[Path, typer.Argument(help="Stream file.")],
    target: Annotated[Path, typer.Option("--out", help="Raw file to write.")],
    *,
    layout: Annotated[
        str | None, typer.Option(help="Layout of the file: 416, dense or sps1000 (default: as the array has it).")
    ] = None,
    reader: Annotated[
        str | None, typer.Option("--for", help="Software that is to read it: spikecv, spike-zoo, saf or rsir.")
    ] = None,
    flip: Annotated[bool | None, typer.Option(help="Store the bottom row first (default: as in the layout).")] = None,
) -> None:
    """Convert a stream to a raw spike file."""
    from saf_gen.stream.interop import READERS, export_raw_frames
    from saf_gen.stream.stream_file import open_stream

    if reader is not None and layout is not None:
        raise BadInput("--layout and --for are both given", hint="keep one: a reader has its layout")
    if reader is not None and reader not in READERS:
        raise unknown("reader", reader, allowed=READERS)
    if layout is None:
        with open_stream(stream) as opened:
            layout = READERS[reader] if reader else "sps1000" if opened.shape[1:] == (1000, 1000) else "dense"
    out.print(f"{export_raw_frames(stream, target, layout=layout, flip=flip)} bytes in {target}, layout {layout}")


def index_command(
    folder: Annotated[Path, typer.Argument(help="Folder of streams (.h5), in it or in folders of splits.")],
    *,
    split: Annotated[str, typer.Option(help="Split of the streams that lie in the folder itself.")] = "test",
) -> None:
    """Make a folder of streams a dataset, which evaluate takes: write its manifest."""
    from saf_gen.stream.dataset_index import index_streams_of_folder

    manifest = index_streams_of_folder(folder, split=split)
    out.print(f"{len(manifest.sequences)} sequences in splits {', '.join(manifest.splits)}: saf-gen evaluate {folder}")


def inspect_command(
    stream: Annotated[Path, typer.Argument(help="Stream file, or s3://BUCKET/NAME.")], *, as_json: AsJson = False
) -> None:
    """Describe a stream: what is in it (length, rates, light, lens, true focus), and how it was made."""
    from saf_gen.stream.description import describe_stream_content, describe_stream_making
    from saf_gen.stream.stream_file import open_stream

    with open_stream(stream) as opened:
        content, making = describe_stream_content(opened), describe_stream_making(opened)
    columns = TableColumn(""), TableColumn("", folds=True)
    if as_json:
        print_table(columns, [*content.items(), *making.items()], as_json=True)
        return
    print_table(columns, content.items(), title=str(opened.path))
    out.print()
    print_table(columns, making.items(), title="how it was made")
