"""The dataset card: README.md, with front matter for the Hugging Face Hub, and croissant.json for programs."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from string import Template
from typing import Any

from saf_gen.core.config.ranges import is_range, range_extremes
from saf_gen.core.files import write_text
from saf_gen.core.plain_text import escape_markdown
from saf_gen.generate.recipe import Recipe
from saf_gen.scene.scene_folder import SceneCard
from saf_gen.stream.manifest import Manifest
from saf_gen.stream.sharing.croissant import SYNTHETIC, DatasetFacts, front_matter, read_licences, write_croissant

PAGE = Template("""# $name: spike-camera autofocus data

Made by saf_gen from a recipe: scenes rendered by Mitsuba through a thin lens, seen by a model of the spike
camera `$sensor`. Every sequence holds its true focus and the lens position at every frame.

| | |
|---|---|
| sequences | $count ($splits) |
| frames per sequence | $frames |
| focus positions rendered | $positions, $samples samples per pixel |
| lens motion | $motion |
| light schedules | $lights |
| recipe fingerprint | `$fingerprint` |

## Scenes

$scenes

## Files

- `croissant.json`: this card for programs ([Croissant](https://mlcommons.org/croissant)).
- `manifest.json`: every sequence with split, scene, light, seed, file and `content_sha256`.
- `<split>/<id>.h5`: a spike stream with its truth, and in `/provenance/recipe` the recipe that makes it again.
- `stacks/`: the focal stacks (OpenEXR), shared by the sequences; needed only to record more.

```python
import saf_gen
with saf_gen.open_stream("$example") as stream:   # from this folder
    print(stream.shape, stream.truth.position)
    image = stream.counts(0, 200)
```

To evaluate focus methods on it, from this folder: `$next_command`; to publish it: `saf-gen pack . --out FOLDER`.
""")


def _describe_motion(motion: dict[str, Any]) -> str:
    """Return a lens motion as Markdown, such as `hand` (bandwidth_hz 10, seed 3)."""
    if is_range(motion):
        return " or ".join(_describe_motion(one) for one in range_extremes(motion))
    options = ", ".join(f"{key} {_describe_value(value)}" for key, value in motion.items() if key != "kind")
    return f"`{motion['kind']}`" + (f" ({escape_markdown(options)})" if options else "")


def _describe_value(value: Any) -> str:
    if is_range(value):
        ((form, among),) = value.items()
        return f"{form} {', '.join(_describe_value(one) for one in among)}"
    return value["path"] if isinstance(value, dict) else str(value)


def _describe_scene(card: SceneCard) -> str:
    licence = card.licence or "not stated"
    return f"- `{card.id}`: {escape_markdown(f'{card.title}. Licence {licence}.')}"


def write_dataset_card(folder: Path, recipe: Recipe, *, manifest: Manifest, scenes: Iterable[SceneCard]) -> None:
    """Write README.md and croissant.json to a dataset folder that has its manifest, each completely or not at all."""
    cards = list(scenes)
    licences = read_licences(card.licence for card in cards)
    splits = Counter(entry.split for entry in manifest.sequences)
    text = PAGE.substitute(
        name=recipe.name,
        sensor=recipe.camera.sensor,
        count=len(manifest.sequences),
        splits=", ".join(f"{split} {count}" for split, count in splits.items()) or "none finished yet",
        frames=recipe.camera.frames,
        positions=recipe.focus.positions,
        samples=recipe.render.samples,
        motion=_describe_motion(recipe.focus.motion),
        lights=escape_markdown(", ".join(recipe.lights)),
        fingerprint=manifest.recipe_fingerprint,
        scenes="\n".join(map(_describe_scene, cards)),
        next_command=manifest.next_command("."),
        example=manifest.sequences[0].file if manifest.sequences else "SPLIT/ID.h5",
    )
    matter = front_matter(manifest, licences, pattern="{split}/*.h5")
    write_text(folder / "README.md", matter + text)
    described = (
        f"Spike-camera autofocus data, rendered and simulated: {len(manifest.sequences)} sequences of "
        f"{recipe.camera.frames} frames, sensor {recipe.camera.sensor}, light {', '.join(recipe.lights)}. Scenes: "
        f"{'; '.join(f'{card.id}, {card.title}' for card in cards)}. Each sequence holds its true focus and the lens "
        "position at every frame."
    )
    write_croissant(folder, manifest, facts=DatasetFacts(described, licences, responsible=SYNTHETIC))
