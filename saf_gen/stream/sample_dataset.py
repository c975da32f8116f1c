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

    It was made by ``recipes/sample.yaml``: three streams of 1,200 frames of 128 × 128 pixels, ``test/*.h5``, with lens,
    light and truth, in 2.6 MB. Do not write to it. Its focal stacks are not there, so it has no closed loop.

    Returns
    -------
    Path
        Folder of the dataset, with its ``manifest.json``.

    Examples
    --------
    >>> import saf_gen
    >>> with saf_gen.open_stream(saf_gen.sample() / "test/usaf_target-constant-00.h5") as stream:
    ...     print(stream.shape, round(stream.truth.position, 2))
    (1200, 128, 128) 0.58
    """
    return shipped_folder("datasets") / SAMPLE
