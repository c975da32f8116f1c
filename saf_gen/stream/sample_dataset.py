"""The small dataset that comes with saf_gen, for a first minute without a renderer."""

from pathlib import Path

from saf_gen.core.shipped import shipped_folder

SAMPLE = "sample"
"""Name of the dataset on the command line, where no folder has this name."""


def find_data(source: Path) -> Path:
    """Return the dataset or recording at a path or, if nothing is there, of a name.

    The name ``sample`` is the sample, and any other that of a folder in ``datasets``, where saf-gen generate writes.
    """
    if source.exists() or source.name != str(source):
        return source
    if str(source) == SAMPLE:
        return sample()
    generated = "datasets" / source
    return generated if generated.is_dir() else source


def sample() -> Path:
    """Return the folder of a small dataset: one scene under three lights, swept through its focus.

    It was made by ``recipes/sample.yaml``: three streams of 640 frames of 128 × 128 pixels, ``test/*.h5``, with lens,
    light and truth, and their focal stack, in 2.8 MB. Do not write to it.

    Returns
    -------
    Path
        Folder of the dataset, with its ``manifest.json``.

    Examples
    --------
    >>> import saf_gen
    >>> with saf_gen.open_stream(saf_gen.sample() / "test/usaf_target-constant-00.h5") as stream:
    ...     print(stream.shape, round(stream.truth.position, 2))
    (640, 128, 128) 0.58
    """
    return shipped_folder("datasets") / SAMPLE


def is_sample(name: str | Path) -> bool:
    """Return whether a name on the command line means the sample: no file or folder here has it."""
    return str(name) == SAMPLE and not Path(name).exists()
