"""Pictures as strangers store them, with content that is known: none may be read wrongly without a word.

``python tests/robustness/foreign_pictures.py --count 500 --seed 1`` draws light, size, bits, container, names, times
and damage, writes each with the library of its format, and reads it: first without an option, then with all options
that apply. It prints how many were read, asked about and refused, and ends with 1 if one was read wrongly, or if one
was refused that is whole and of a kind that is read.
"""

import argparse
import sys
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import OpenEXR
import tifffile
from PIL import Image
from scipy.io import savemat

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
from foreign_videos import write_video_file

from saf_gen.camera import get_sensor
from saf_gen.errors import BadInput
from saf_gen.stream.interop.encode_pictures import encode_pictures, prepare_pictures
from saf_gen.stream.interop.picture_frames import open_pictures
from saf_gen.stream.stream_file import open_stream

SIZES = [(8, 10), (12, 16), (16, 16), (24, 32), (32, 18), (20, 50)]
KINDS = ("images", "exr", "pages", "array", "video")
WEIGHTS = (0.28, 0.12, 0.15, 0.17, 0.28)
READOUT_HZ = 20_000
BT709, BT2020 = (0.2126, 0.7152, 0.0722), (0.2627, 0.6780, 0.0593)
RATES = [
    Fraction(text) for text in ("24 25 30 60 240 1000 10000 40000 60000 200000 24000/1001 30000/1001 7777".split())
]
EXACT, ROUNDED, LOSSY = 1e-5, 0.02, 0.12
"""Largest error of a value of light, as a fraction of the brightest: of a file that keeps every bit, of one that is
converted from YUV of 8 bits, and of one that is compressed with loss."""


@dataclass(frozen=True)
class Foreign:
    """A source that was written, and what is in it.

    ``light`` is linear, (n, H, W); ``times`` are those of the pictures in s, from the first, and ``tick`` how exactly
    they are stored; None if the source states no times. ``options`` are those of ``open_pictures``. ``z`` are the
    positions of a stack. ``is_read`` is False for what must be refused.
    """

    path: Path
    light: np.ndarray
    kind: str
    stored: str
    tolerance: float = EXACT
    times: np.ndarray | None = None
    tick: float = 1e-9
    options: dict[str, object] = field(default_factory=dict)
    z: np.ndarray | None = None
    damage: str = ""
    is_read: bool = True


def state(curve: str) -> dict[str, object]:
    """Return the option by which a user states a curve."""
    return {"linear": True} if curve == "linear" else {"transfer": curve}


def decode(values: np.ndarray, curve: str) -> np.ndarray:
    """Return the light of stored values from 0 to 1."""
    v = np.asarray(values, np.float64)
    if curve == "linear":
        return v
    if curve == "bt709":  # ITU-R BT.709, the inverse of 1.2
        return np.where(v < 0.081, v / 4.5, ((v + 0.099) / 1.099) ** (1 / 0.45))
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def to_light(values: np.ndarray, curve: str, weights: tuple[float, ...] = (0.2126, 0.7152, 0.0722)) -> np.ndarray:
    """Return the luminance (n, H, W) of stored grey values (n, H, W) or colours (n, H, W, 3)."""
    light = decode(values, curve)
    return light if light.ndim == 3 else light @ np.array(weights)


def draw_values(random: np.random.Generator, count: int, size: tuple[int, int], *, colour: bool) -> np.ndarray:
    """Return smooth values from 0.02 to 1, (n, H, W) or (n, H, W, 3), in which no two pictures are alike."""
    rows, columns = np.mgrid[0 : size[0], 0 : size[1]] / max(size)
    phase = random.uniform(0, 6, 3)
    waves = [0.75 + 0.25 * np.sin(3 * rows + 2 * columns + p) for p in phase[: 3 if colour else 1]]
    picture = np.stack(waves, axis=-1) if colour else waves[0]
    steps = np.arange(count) / max(count, 8)
    light = str(random.choice(["slow", "shuffled", "flash", "fast"]))
    if light == "flash":
        gain = 0.1 + 0.1 * steps
        gain[random.integers(count)] = 1.0
    elif light == "fast":
        gain = np.where(np.arange(count) % 2, 0.9, 0.1) + 0.1 * steps
    else:
        gain = 0.3 + 0.7 * (steps if light == "slow" else random.permutation(steps))
    return np.multiply.outer(gain, picture)


def quantise(values: np.ndarray, bits: int) -> np.ndarray:
    top = 2**bits - 1
    return np.rint(values * top).astype(np.uint8 if bits <= 8 else np.uint16)


# Folders of images.

NAMES: dict[str, Callable[[int], str]] = {
    "signed": lambda k: f"z_{k - 3}",
    "decimals": lambda k: f"z_{round(0.05 * (k + 1), 2)}",
    "signed decimals": lambda k: f"z_{round(0.25 * (k - 2), 2)}",
    "numbers": lambda k: f"frame{k + 5}",
    "zeros": lambda k: f"frame_{k:05d}",
    "steps": lambda k: f"t{93 + 7 * k}ms",
    "hyphens": lambda k: f"scene-{k + 8}",
    "alone": lambda k: str(k + 7),
    "two numbers": lambda k: f"run2_{k}",
}
TURNS: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, 1),
    7: lambda a: np.rot90(a, 2).swapaxes(0, 1),
    8: lambda a: np.rot90(a, -1),
}
"""What a file with this value of Exif's orientation stores of an upright picture."""
IMAGES = {
    # name: ending, bits, colour, tolerance, mode of the file
    "png grey": ("png", 8, False, EXACT, "L"),
    "png colour": ("png", 8, True, EXACT, "RGB"),
    "png with alpha": ("png", 8, True, EXACT, "RGBA"),
    "png palette": ("png", 8, False, EXACT, "P"),
    "png 16 bits": ("png", 16, False, EXACT, "I;16"),
    "jpeg grey": ("jpg", 8, False, LOSSY, "L"),
    "jpeg colour": ("jpeg", 8, True, LOSSY, "RGB"),
    "tiff": ("tif", 8, False, EXACT, "L"),
    "tiff colour": ("tiff", 8, True, EXACT, "RGB"),
    "tiff 16 bits": ("tif", 16, False, EXACT, "uint16"),
    "tiff colour 16 bits": ("tif", 16, True, EXACT, "uint16"),
    "tiff floats": ("tif", 24, False, EXACT, "float32"),
    "webp": ("webp", 8, True, EXACT, "RGB"),
    "webp lossy": ("webp", 8, True, LOSSY, "RGB"),
    "bmp": ("bmp", 8, False, EXACT, "L"),
    "bmp colour": ("BMP", 8, True, EXACT, "RGB"),
    "pgm": ("pgm", 8, False, EXACT, "L"),
    "pgm 16 bits": ("pgm", 16, False, EXACT, "I;16"),
    "ppm": ("ppm", 8, True, EXACT, "RGB"),
}
CHECKED = {"png"}
"""Endings of images whose format has checksums, so that a changed byte can be seen."""


def write_image(
    path: Path, values: np.ndarray, mode: str, *, orientation: int, lossless: bool, states_srgb: bool
) -> None:
    """Write integers (H, W) or (H, W, 3) that are shown after the turn of ``orientation``."""
    stored = np.ascontiguousarray(TURNS[orientation](values))
    if mode in ("uint16", "float32"):
        kind = "rgb" if values.ndim == 3 else "minisblack"
        tags = [(274, "H", 1, orientation, False)]
        tifffile.imwrite(path, stored, photometric=kind, metadata=None, extratags=tags if orientation > 1 else [])
        return
    if mode == "P":
        image = Image.fromarray(255 - stored).convert("P")
        image.putpalette([level for index in range(255, -1, -1) for level in (index,) * 3])
    elif mode == "RGBA":
        alpha = np.full(stored.shape[:2], 130, np.uint8)
        image = Image.fromarray(np.dstack([stored, alpha]))
    else:
        image = Image.fromarray(stored)
    settings: dict[str, object] = {}
    if path.suffix in (".tif", ".tiff"):
        settings["tiffinfo"] = {274: orientation}
        settings["compression"] = ("raw", "packbits", "tiff_deflate")[stored.shape[0] % 3]
    elif orientation > 1 or states_srgb:
        settings["exif"] = exif = Image.Exif()
        exif[0x0112] = orientation
        exif.get_ifd(0x8769)[0xA001] = 1 if states_srgb else 65535
    if path.suffix == ".webp" and lossless:
        settings["lossless"] = True
    elif path.suffix in (".jpg", ".jpeg", ".webp"):
        settings |= {"quality": 97, "subsampling": 0}
    image.save(path, **settings)  # type: ignore[arg-type]


def write_images(random: np.random.Generator, folder: Path, count: int, size: tuple[int, int]) -> Foreign:
    """Draw and write a folder of images."""
    what, naming = str(random.choice(list(IMAGES))), str(random.choice(list(NAMES)))
    ending, bits, colour, tolerance, mode = IMAGES[what]
    values = draw_values(random, count, size, colour=colour)
    integers = values.astype(np.float32) if mode == "float32" else quantise(values, bits)
    turned = ending in ("png", "jpg", "jpeg", "tif", "tiff", "webp")
    orientation = int(random.integers(1, 9)) if turned and random.random() < 0.3 else 1
    states_srgb = ending in ("png", "jpg", "jpeg", "webp") and random.random() < 0.4
    curve = "srgb" if states_srgb else str(random.choice(["srgb", "bt709", "linear"]))
    path = folder / "in"
    path.mkdir()
    lossless = tolerance == EXACT
    for number in random.permutation(count):
        file = path / f"{NAMES[naming](number)}.{ending}"
        write_image(file, integers[number], mode, orientation=orientation, lossless=lossless, states_srgb=states_srgb)
    stored = integers if mode == "float32" else integers / (2**bits - 1)
    said = "sRGB" if states_srgb else f"no transfer ({curve})"
    what = f"{what}, names {naming}, turned {orientation}, {said}"
    options = {} if states_srgb else state(curve)
    return Foreign(path, to_light(stored, curve), "images", what, tolerance, options=options)


def write_exr(random: np.random.Generator, folder: Path, count: int, size: tuple[int, int]) -> Foreign:
    """Draw and write a folder of OpenEXR files, or one."""
    colour = bool(random.integers(2))
    light = draw_values(random, count, size, colour=colour) * float(random.choice([1, 50]))
    kind = str(random.choice(["float16", "float32", "uint32"], p=[0.45, 0.45, 0.1]))
    light = np.rint(light * 1000).astype(np.uint32) if kind == "uint32" else light.astype(kind)
    loss = {"B44": 0.06, "DWAA": 0.06}
    compression = str(random.choice(["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", *loss]))
    tolerance = 1e-4 if compression == "PXR24" else loss.get(compression, EXACT)
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    if random.integers(2):
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    weights, primaries = BT709, str(random.choice(["none", "BT.709", "BT.2020"]))
    if primaries != "none":
        wide = primaries == "BT.2020"
        header["chromaticities"] = (
            *((0.708, 0.292, 0.170, 0.797, 0.131, 0.046) if wide else (0.64, 0.33, 0.30, 0.60, 0.15, 0.06)),
            *(0.3127, 0.3290),
        )
        weights = BT2020 if wide else BT709
        tolerance = max(tolerance, 1e-3)
    layer = str(random.choice(["", "view.combined."]))
    path = folder / "in"
    path.mkdir()
    naming = str(random.choice(list(NAMES)))
    for number in random.permutation(count):
        picture = light[number]
        planes = dict(zip("RGB", np.moveaxis(picture, -1, 0), strict=True)) if colour else {"Y": picture}
        planes |= {"A": np.ones(size, picture.dtype)}
        channels = {f"{layer}{name}": np.ascontiguousarray(plane) for name, plane in planes.items()}
        OpenEXR.File(dict(header), channels).write(str(path / f"{NAMES[naming](number)}.exr"))
    exact = to_light(light.astype(np.float64), "linear", weights)
    what = f"{compression} {kind} {'tiles' if 'tiles' in header else 'lines'}, {primaries}, names {naming}"
    return Foreign(path, exact, "exr", what, tolerance)


# Files with several pictures.


def write_pages(random: np.random.Generator, folder: Path, count: int, size: tuple[int, int]) -> Foreign:
    """Draw and write a TIFF of several pages, perhaps a stack that states its z."""
    what = str(random.choice(["plain", "turned", "OME", "ImageJ"]))
    colour = what == "plain" and bool(random.integers(2))
    kind = str(random.choice(["uint8", "uint16"] if colour else ["uint8", "uint16", "float32"]))
    values = draw_values(random, count, size, colour=colour)
    integers = values.astype(np.float32) if kind == "float32" else quantise(values, 8 * np.dtype(kind).itemsize)
    path, orientation, z = folder / "in.tif", int(random.integers(2, 9)) if what == "turned" else 1, None
    stored = np.ascontiguousarray([TURNS[orientation](one) for one in integers])
    settings: dict[str, object] = {"photometric": "rgb" if colour else "minisblack"}
    if what == "ImageJ":
        z = np.arange(count) * 0.3
        settings |= {"imagej": True, "metadata": {"axes": "ZYX", "spacing": 0.3, "unit": "um"}}
    elif what == "OME":
        z = np.cumsum(random.choice([0.5, 1, 2], count))
        plane = {"PositionZ": z.tolist(), "PositionZUnit": ["µm"] * count}
        settings |= {"ome": True, "metadata": {"axes": "ZYX", "Plane": plane}}
    else:
        settings["metadata"] = None
        settings["compression"] = str(random.choice(["none", "zlib"])) if what == "plain" else "none"
        if what == "turned":
            settings["extratags"] = [(274, "H", 1, orientation, False)]
    tifffile.imwrite(path, stored, **settings)  # type: ignore[arg-type]
    levels = integers if kind == "float32" else integers / np.iinfo(integers.dtype).max
    curve = str(random.choice(["srgb", "bt709", "linear"]))
    what = f"{what} {kind} turned {orientation} ({curve})"
    return Foreign(path, to_light(levels, curve), "pages", what, z=z, options=state(curve))


def write_array(random: np.random.Generator, folder: Path, count: int, size: tuple[int, int]) -> Foreign:
    """Draw and write an array of values, or of light."""
    ending, channels = str(random.choice(["npy", "npz", "mat"])), int(random.choice([0, 1, 3, 4]))
    kind = str(
        random.choice(["uint8", "uint16", "float32", "float64", "light", "12 bits"] + ["float16"] * (ending != "mat"))
    )
    values = draw_values(random, count, size, colour=channels >= 3)
    if channels == 1:
        values = values[..., None]
    curve = str(random.choice(["srgb", "bt709", "linear"]))
    if kind == "light":  # above 1
        array = (values * random.uniform(2, 100) / values.max()).astype(np.float32)
        curve, levels = "linear", array
    elif kind == "12 bits":
        array = quantise(values, 12)
        curve, levels = "linear", array / 65535
    elif kind.startswith("uint"):
        array = quantise(values, 8 * np.dtype(kind).itemsize)
        levels = array / np.iinfo(array.dtype).max
    else:
        array = values.astype(kind)
        levels = array
    options = state(curve)
    if channels == 4:
        alpha = np.full((*array.shape[:3], 1), array.max())
        array = np.concatenate([array, alpha.astype(array.dtype)], axis=3)
    path, several = folder / f"in.{ending}", bool(random.integers(2))
    others = {"other": array[:, ::-1], "rate": np.array([25.0])} if several else {}
    if ending == "npy":
        np.save(path, np.asfortranarray(array) if several else array)
    elif ending == "npz":
        (np.savez_compressed if random.integers(2) else np.savez)(path, pictures=array, **others)
    else:  # MATLAB has the frames on the last axis
        array = np.moveaxis(array, 0, -1)
        savemat(path, {"pictures": array, **others}, do_compression=bool(random.integers(2)))
    if several and ending != "npy":
        options["key"] = "pictures"
    levels = levels[..., 0] if channels == 1 else levels
    light = to_light(np.asarray(levels, np.float64), curve)
    return Foreign(path, light, "array", f"{ending} {kind} {array.shape} ({curve})", options=options)


def write_video(random: np.random.Generator, folder: Path, count: int, size: tuple[int, int]) -> Foreign:
    """Draw and write a video; see :mod:`foreign_videos`."""
    found = write_video_file(random, folder, lambda colour: draw_values(random, count, size, colour=colour))
    light = to_light(found.levels, found.curve, found.weights)
    tolerance = {"exact": 0.004, "rounded": ROUNDED, "lossy": LOSSY}[found.loss]
    options = {} if found.is_stated else state(found.curve)
    return Foreign(
        found.path, light, "video", found.stored, tolerance, found.times, found.tick, options, is_read=found.is_read
    )


WRITERS = {
    "images": write_images, "exr": write_exr, "pages": write_pages, "array": write_array,
    "video": write_video,
}  # fmt: skip


def write_foreign(random: np.random.Generator, folder: Path) -> Foreign:
    """Draw and write one source; one of six is damaged."""
    kind = str(random.choice(KINDS, p=WEIGHTS))
    count, size = int(random.integers(3, 12)), SIZES[random.integers(len(SIZES))]
    if kind == "array" and random.integers(2):  # enough for rates above that of the readouts
        count, size = int(random.integers(100, 900)), SIZES[0]
    file = WRITERS[kind](random, folder, count, size)
    return spoil(random, file) if random.random() < 1 / 6 else file


def spoil(random: np.random.Generator, file: Foreign) -> Foreign:
    """Cut a file, or change some bytes of one whose format has checksums."""
    inside = sorted(file.path.iterdir()) if file.path.is_dir() else [file.path]
    path = inside[random.integers(len(inside))]
    content = bytearray(path.read_bytes())
    checked = path.suffix.lstrip(".") in CHECKED or path.suffix == ".npz" or "slicecrc" in file.stored
    if checked and random.integers(2):
        for at in random.integers(len(content) // 3, len(content) * 9 // 10, 3):
            content[at] ^= int(random.integers(1, 256))
        damage = f"three bytes of {path.name} changed"
    else:
        kept = int(random.integers(1, len(content)))
        content, damage = content[:kept], f"{path.name} cut to {kept} of {len(content)} bytes"
    path.write_bytes(content)
    return replace(file, damage=damage)


# Reading, and what was read.


def judge(file: Foreign, options: dict[str, object]) -> tuple[str, str]:
    """Return ``read``, ``asked`` or ``wrong``, and why."""
    try:
        source = open_pictures(file.path, **options)  # type: ignore[arg-type]
        if not source.is_stated:
            return "asked", "how values stand for light"
        found = np.stack(list(source)).astype(np.float64)
    except BadInput as error:
        return "asked", str(error)
    if found.shape != file.light.shape:
        return "wrong", f"shape {found.shape}, not {file.light.shape}"
    found *= file.light.mean() / max(found.mean(), 1e-30)  # light has no unit
    top = file.light.max()
    error = np.abs(found - file.light).max() / top
    means = np.abs(found.mean(axis=(1, 2)) - file.light.mean(axis=(1, 2))).max() / top
    if error > file.tolerance or means > file.tolerance / 2:
        return "wrong", f"light is {error:.2g} of the brightest off, of whole pictures {means:.2g}"
    if file.z is not None and not np.allclose(source.positions.z, file.z):
        return "wrong", f"positions {source.positions}, not {file.z}"
    if file.times is None or "changed" in file.damage:
        return "read", ""
    times = stated_times(source, len(found))
    if times is None:
        return "asked", "it states no times"
    late = np.abs(times - file.times).max()
    return ("read", "") if late <= file.tick else ("wrong", f"times are {late:.3g} s off: {times}, not {file.times}")


def stated_times(source: object, count: int) -> np.ndarray | None:
    """Return the times in s that a source states for its pictures, from the first."""
    times, rate = getattr(source, "times", None), getattr(source, "rate_hz", None)
    if rate is not None:
        return np.arange(count) / float(rate)
    return None if times is None or None in times else np.array([float(time) for time in times])


def judge_stream(random: np.random.Generator, file: Foreign) -> str:
    """Encode a source with the ideal sensor, and return how its length or mean rate is off, or ''.

    The mean rate is the integral of the light, which is linear between two pictures, over that of the mean picture, in
    which pictures at uneven times count for as long as they last.
    """
    source = open_pictures(file.path, **file.options)  # type: ignore[arg-type]
    rate, times, last = None, file.times, len(file.light) - 1
    if times is None:
        fitting = [rate for rate in RATES if 40 <= last / rate * READOUT_HZ <= 20_000]
        rate = fitting[random.integers(len(fitting))]
        times = np.arange(last + 1) / float(rate)
    frames = int(times[-1] * READOUT_HZ + 1e-6)
    if not 40 <= frames <= 20_000:
        return ""
    level = file.light.mean(axis=(1, 2))
    mean_rate = min(0.2, 0.8 * file.light.mean(axis=0).min() / file.light.max())
    out = file.path.parent / "out.h5"
    plan = prepare_pictures(source, get_sensor("ideal"), rate_hz=rate, mean_rate=mean_rate)
    encode_pictures(plan, out)
    with open_stream(out) as stream:
        counts, length = stream.counts(0, stream.shape[0]).mean(), stream.shape[0]
    if abs(length - frames) > 1 + file.tick * READOUT_HZ:
        return f"{length} readouts, not {frames}"
    at = np.linspace(0, length / READOUT_HZ, 20_001)
    mean = level.mean() if plan.rate_hz is not None else np.trapezoid(level, times) / times[-1]
    expected = mean_rate * length * np.trapezoid(np.interp(at, times, level), at) / at[-1] / mean
    # Every pixel begins empty, and so loses up to one spike.
    if not expected * (0.985 - file.tolerance / 4) - 1 <= counts <= expected * (1.015 + file.tolerance / 4):
        return f"{counts:.2f} spikes per pixel, not {expected:.2f}, in {length} readouts"
    return ""


def run(count: int, seed: int) -> tuple[Counter[tuple[str, str, str]], list[str]]:
    """Return how many sources of each kind were read, asked about, refused or wrong, and faults."""
    found: Counter[tuple[str, str, str]] = Counter()
    faults = []
    for number in range(count):
        if number and number % 100 == 0:
            print(f"{number} of {count}: {len(faults)} faults", file=sys.stderr)
        random = np.random.default_rng([seed, number])
        with TemporaryDirectory(prefix="foreign-") as folder:
            file = write_foreign(random, Path(folder))
            for how, verdict, why in judge_both(random, file):
                found[file.kind, how, verdict] += 1
                refused = how == "with options" and verdict == "asked"
                if verdict == "wrong" or refused:
                    what = f"{file.kind}, {file.stored}{f', {file.damage}' if file.damage else ''}"
                    faults.append(f"--seed {seed} number {number}: {what}, {how}: {verdict}, {why}")
    return found, faults


def judge_both(random: np.random.Generator, file: Foreign) -> list[tuple[str, str, str]]:
    """Return how a source is read without an option and with all that apply: how, verdict, why."""
    results = []
    for how, options in (("unasked", {}), ("with options", file.options)):
        try:
            verdict, why = judge(file, options)
            if verdict == "read" and not file.is_read:
                verdict, why = "wrong", "it should be refused"
            checked = len(file.light) > 50 or random.random() < 0.4
            if how == "with options" and verdict == "read" and not file.damage and checked:
                why = judge_stream(random, file)
                verdict = "wrong" if why else verdict
        except Exception:  # noqa: BLE001, a traceback is a fault as well
            verdict, why = "wrong", traceback.format_exc(limit=-3)
        if verdict == "asked" and (file.damage or not file.is_read):
            verdict = "refused"
        results.append((how, verdict, why))
    return results


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    found, faults = run(asked.count, asked.seed)
    for how in ("unasked", "with options"):
        for kind in KINDS:
            counts = {verdict: found[kind, how, verdict] for verdict in ("read", "asked", "refused", "wrong")}
            print(f"{how:13} {kind:10} " + "  ".join(f"{name} {n}" for name, n in counts.items()))
    print("\n".join(faults) or "none was read wrongly")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
