"""Renders the all-in-focus picture of a recording, which is a focal stack of a lens with the aperture of a point."""

from pathlib import Path

import numpy as np

from saf_gen.core.config.json_document import load_plain_json
from saf_gen.errors import BadInput
from saf_gen.render import backend, render_missing
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.all_in_focus import AllInFocus, held_picture
from saf_gen.stream.stream_file import SpikeStream


def render_all_in_focus(stream: SpikeStream, stacks: str | Path, *, variant: str = "auto") -> np.ndarray:
    """Return the all-in-focus charge of a stream, which it holds; if not, it is rendered into the folder of stacks.

    What is there already is not rendered again, and sequences of one scene share it. It has as many samples as the
    stack of the recording.

    Parameters
    ----------
    stream : SpikeStream
        Stream of a scene at rest that `saf-gen generate` made.
    stacks : str or Path
        Folder ``stacks`` of its dataset, which also keeps the picture.
    variant : str, default 'auto'
        Renderer: auto, cuda, llvm or scalar.

    Returns
    -------
    ndarray of float32, shape (light, row, col)
        As of :func:`saf_gen.stack.all_in_focus.load_all_in_focus`.

    Raises
    ------
    BadInput
        If :meth:`saf_gen.stack.all_in_focus.AllInFocus.of_stream` refuses the stream, if its scene is missing or has
        changed since, or if the renderer cannot run.
    """
    if (held := held_picture(stream)) is not None:
        return held
    picture = AllInFocus.of_stream(stream, Path(stacks))
    scene = find_scene(picture.spec.scene).with_params(load_plain_json(picture.spec.params))
    if scene.digest != picture.spec.scene_digest:
        raise BadInput(
            f"scene {scene.id!r} has changed since this was made",
            where=str(stream.path),
            allowed="the scene as it was",
            hint="run saf-gen generate again",
        )
    backend_name = backend.choose_backend(variant)
    render_missing(scene, [picture.spec], root=picture.stacks, backend_name=backend_name)
    return picture.load()
