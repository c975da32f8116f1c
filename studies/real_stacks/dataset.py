"""Objects of photographed stacks, their boxes, and the dataset of recordings that is made of them."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from saf_gen.camera import Encoder, Sensor, get_sensor
from saf_gen.camera.encoder import knot_weights
from saf_gen.core.config.document import Document, FrozenModel, validate_document
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.core.files import file_sha256
from saf_gen.core.seeds import derive_seed
from saf_gen.errors import BadInput, unknown
from saf_gen.plugins.lights import gains_at_readouts, get_light
from saf_gen.stream.interop.picture_frames import IMAGES, open_pictures
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, SequenceEntry, read_manifest, write_manifest
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.sharing.croissant import PHOTOGRAPHS, DatasetFacts, read_licences, write_croissant
from saf_gen.stream.stream_writer import StreamWriter
from studies.real_stacks.truth import BoxTruth, box_truth, share_in_focus

SOURCES, FILES = (Path(__file__).with_name(name) for name in ("sources.yaml", "files.sha256"))
SIDE = 128
"""Pixels along each side of a box, at the pictures' own size: a smaller picture would mix depths in a pixel."""
BOXES = 6
"""Largest number of boxes of an object."""
MOST = 0.1
"""Largest unit, as a fraction of the travel."""
FRAMES, RATE = 8000, 0.1
"""Readouts of a recording, and spikes per pixel and readout in focus at gain 1."""
ONE_DEPTH = 0.5
"""Share of the blocks of a box in focus at the truth from which it counts as one depth."""
CLASSES = ("one_depth", "several_depths")
UNRANKED = "grade_c"
"""Splits of the dataset: the classes of boxes, and all boxes of objects that are not ranked."""
LIGHTS: dict[str, dict[str, Any]] = {
    "constant": {"kind": "constant"},
    "continuous": {"kind": "ramp", "from": 0.5, "to": 2.0},
    "sudden": {"kind": "steps", "every_s": 0.08, "levels": [1.0, 0.4, 2.0]},
    "mains": {"kind": "flicker", "hz": 100, "depth": 0.5},
}
PROTOCOL = {
    "rai:dataPreprocessingProtocol": "Pictures are decoded to light and cropped, and never shrunk.",
    "rai:dataAnnotationProtocol": "The true focus is the median of the peaks of four focus measures on the pictures.",
}


class Source(FrozenModel):
    """An object of the list of sources; the head of the list says what the keys mean."""

    grade: Literal["A", "B", "C"]
    title: str
    licence: str
    source: str
    pictures: int
    files: str = ""
    prepared: str = ""
    transfer: str = "srgb"
    dark: int = 0
    seams: tuple[int, ...] = ()
    focus: float | None = None


@dataclass(frozen=True, eq=False)
class Box:
    """A box of an object: left and top in pixels, its light float32 (focus, SIDE, SIDE), its truth, and its class.

    ``unit`` is that of the object, in pictures.
    """

    left: int
    top: int
    light: np.ndarray
    truth: BoxTruth
    unit: float = 1.0
    share: float = 0.0

    @property
    def best(self) -> float:
        """The truth by all families, in pictures."""
        return self.truth.without() or 0.0


def read_sources(path: Path, names: Sequence[str] = ()) -> dict[str, Source]:
    """Return the objects of a list, or those that are named; without names, only objects that are ranked.

    Raises BadInput if the list cannot be read or has no object of a name.
    """
    document = read_yaml(path)
    listed = {
        name: validate_document(Source, Document(of, document.path, find_lines=dict))
        for name, of in document.data.items()
    }
    for name in names:
        if name not in listed:
            raise unknown("object", name, allowed=listed, where=str(path))
    return {name: of for name, of in listed.items() if name in names or (not names and of.grade != "C")}


def find_files(folder: Path, name: str, source: Source) -> list[Path]:
    """Return the pictures of an object; raise BadInput, which names its source, if they are not all there."""
    files = [p for p in (folder / name).iterdir() if p.suffix.lower() in IMAGES] if (folder / name).is_dir() else []
    if len(files) != source.pictures:
        have = f"{len(files)} pictures" if files else "no pictures"
        raise BadInput(
            f"{have} of {name} in {folder / name}",
            allowed=f"{source.pictures}: {source.files or 'all'} of {source.source}",
            hint="fetch them, or name the objects that you have with --object",
        )  # fmt: skip
    return files


def count_other_files(files: Sequence[Path], listed: Path) -> int:
    """Return how many of the pictures of an object are not in a list of digests by their bytes."""
    known = {line.split()[0] for line in listed.read_text(encoding="utf-8").splitlines()} if listed.is_file() else None
    return 0 if known is None else sum(file_sha256(file) not in known for file in files)


def read_light(folder: Path, source: Source) -> np.ndarray:
    """Return the linear light of the pictures of an object, in the order of their names, float32 (focus, row, col)."""
    linear = source.transfer == "linear"
    pictures = np.stack(list(open_pictures(folder, linear=linear, transfer=None if linear else source.transfer)))
    return np.maximum(pictures - np.float32(source.dark / 65535), 0)


def choose_boxes(light: np.ndarray, source: Source, *, count: int = BOXES) -> list[Box]:
    """Return the boxes of an object by the rule, in the order of their truth.

    Boxes stand side by side from the upper left, and begin anew below each seam. A box counts if every measure has a
    peak in it, and if its truth is known to half of the width of its curve, which it is not in noise. The unit of the
    object is half of the width below which the curves of a quarter of these boxes are: relief makes a curve wider than
    the lens does, and nothing makes it narrower. It is at most MOST of the travel, so that a guess is rarely right, and
    at least a picture, since between two there is only their mix. Of the boxes whose truth is known to half a unit, and
    is a unit or more from both ends of the stack, ``count`` are taken whose ranks by the truth are evenly spread.
    """
    edges = [0, *source.seams, light.shape[1]]
    places = [
        (top, left)
        for first, stop in pairwise(edges)
        for top in range(first, stop - SIDE + 1, SIDE)
        for left in range(0, light.shape[2] - SIDE + 1, SIDE)
    ]
    known = []
    for top, left in places:
        box = light[:, top : top + SIDE, left : left + SIDE]
        truth = box_truth(box, source.focus)
        if truth is not None and truth.uncertainty <= truth.width / 2:
            known.append(Box(left, top, box, truth))
    if not known:
        return []
    last = len(light) - 1
    unit = max(min(float(np.quantile([box.truth.width for box in known], 0.25)) / 2, MOST * last), 1.0)
    sure = [b for b in known if b.truth.uncertainty <= unit / 2 and unit <= b.best <= last - unit]
    sure.sort(key=lambda b: (b.best, b.top, b.left))
    ranks = np.linspace(0, len(sure) - 1, min(count, len(sure))).round().astype(int)
    return [replace(sure[n], unit=unit, share=share_in_focus(sure[n].light, sure[n].best, unit)) for n in ranks]


def make_dataset(
    folder: Path,
    out: Path,
    *,
    sources: dict[str, Source],
    listed: Path = FILES,
    sensor: str = "vidar_128x128",
    boxes: int = BOXES,
    tell: Callable[[str], None] = print,
) -> Manifest:
    """Record at most ``boxes`` boxes of each object under each light into a dataset folder; return its manifest.

    A folder that is this dataset already is left as it is; one that is another is refused. Nothing is written unless
    the pictures of every object are there. Raises BadInput also if pictures cannot be read.
    """
    recipe = json.dumps(
        {"sources": {name: s.model_dump() for name, s in sources.items()}, "lights": LIGHTS, "sensor": sensor,
         "numbers": [SIDE, boxes, FRAMES, RATE, ONE_DEPTH]}
    )  # fmt: skip
    fingerprint = hashlib.sha256(recipe.encode()).hexdigest()
    if (out / MANIFEST_NAME).exists():
        manifest = read_manifest(out)
        if manifest.recipe_fingerprint != fingerprint:
            raise BadInput("is another dataset", where=str(out), hint="name another folder with --out")
        return manifest
    files = {name: find_files(folder, name, source) for name, source in sources.items()}
    camera = replace(get_sensor(sensor), rows=SIDE, columns=SIDE)
    entries: list[SequenceEntry] = []
    for name, source in sources.items():
        if others := count_other_files(files[name], listed):
            tell(f"{name}: {others} of {len(files[name])} files are not those of {listed.name}, so figures may differ")
        chosen = choose_boxes(read_light(folder / name, source), source, count=boxes)
        tell(f"{name}: boxes {len(chosen)}" + (f", unit {chosen[0].unit:.2f} pictures" if chosen else ""))
        entries += [entry for n, box in enumerate(chosen) for entry in _record(name, source, n, box, camera, out)]
    if not entries:
        raise BadInput("no box has a truth", where=str(folder), allowed="pictures with a peak of sharpness in between")
    manifest = Manifest("real_stacks", fingerprint, "photographed", tuple(entries))
    write_manifest(out, manifest)
    of = "; ".join(f"{name}, {s.title} ({s.licence}, {s.source})" for name, s in sources.items())
    described = f"Boxes of photographed focal stacks, seen by a simulated spike camera, {sensor}. Objects: {of}."
    licences = read_licences(s.licence for s in sources.values())
    write_croissant(out, manifest, facts=DatasetFacts(described, licences, responsible=PHOTOGRAPHS | PROTOCOL))
    return manifest


def _record(name: str, source: Source, number: int, box: Box, sensor: Sensor, out: Path) -> Iterator[SequenceEntry]:
    """Record a box under each light, and yield the entries of the manifest."""
    split = UNRANKED if source.grade == "C" else CLASSES[box.share < ONE_DEPTH]
    last, best = len(box.light) - 1, box.best
    facts = {
        "object": name, "box": [box.left, box.top, SIDE, SIDE], "pictures": last + 1, "unit_pictures": box.unit,
        "share_in_focus": box.share, "truth": asdict(box.truth), "source": source.source, "licence": source.licence,
    }  # fmt: skip
    at_best = float(box.light[round(best)].mean())
    charge = box.light * np.float32(RATE * sensor.threshold_e / at_best)
    lens = ((np.arange(FRAMES) + 0.5) / FRAMES).astype(np.float32)
    index, fraction = knot_weights(lens, last + 1)
    known = Truth(
        position=best / last,
        depth_of_focus=((best - box.unit / 2) / last, (best + box.unit / 2) / last),
        frame=frame_of(best, last),
        target=np.ones((SIDE, SIDE), bool),
        sharpness=(box.light.var(axis=(1, 2), dtype=float) / box.light.mean(axis=(1, 2), dtype=float) ** 2),
    )
    (out / split).mkdir(parents=True, exist_ok=True)
    for light, options in LIGHTS.items():
        sequence, seed = f"{name}-{number:02d}-{light}", derive_seed("real_stacks", name, number, light) >> 1
        schedule = get_light(options["kind"], **{key: value for key, value in options.items() if key != "kind"})
        gain = gains_at_readouts(schedule, FRAMES, readout_hz=sensor.readout_hz).astype(np.float32)[:, None]
        camera = Encoder(sensor, (SIDE, SIDE), seed=seed, device_seed=derive_seed("real_stacks", "device"))
        spikes = camera.encode(charge[None], index=index, fraction=fraction, gain=gain)
        text = json.dumps({**facts, "light": {light: options}})
        provenance = {"real_stack": text, "sensor": yaml.safe_dump(sensor.as_dict(), sort_keys=False)}
        metadata = Metadata(focus_position=lens, gain=gain, light_names=("light",), truth=known, provenance=provenance)
        path = out / split / f"{sequence}.h5"
        shape = (FRAMES, SIDE, SIDE)
        with StreamWriter(path, shape=shape, readout_hz=sensor.readout_hz, metadata=metadata) as writer:
            writer.write(spikes)
        yield SequenceEntry(
            sequence, split, name, number, "static", "sweep", light, 0, seed, f"{split}/{sequence}.h5", FRAMES,
            hashlib.sha256(text.encode() + box.light.tobytes()).hexdigest(), writer.content_sha256,
        )  # fmt: skip


def frame_of(picture: float, last: int) -> float:
    """Return the frame in which the lens passes a picture, of which the last has the number ``last``."""
    return picture / last * FRAMES - 0.5
