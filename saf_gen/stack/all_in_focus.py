"""The all-in-focus picture of a recording: what its lens would draw if its aperture were a point.

It is a focal stack of its own, of the same scene, lights and pixels, whose lens has an aperture so small that nothing
blurs, rendered by :func:`saf_gen.render.all_in_focus.render_all_in_focus` at the two positions around the true focus.
It has the scale and the perspective of the depth map, and the amount of light of the recording's own aperture, so that
it equals the recorded picture where that is in focus. It lies beside the stacks of a dataset and is no part of the
streams.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import charge_of_images
from saf_gen.errors import BadInput
from saf_gen.optics import FittedLensDrive
from saf_gen.stack.capture import Capture
from saf_gen.stack.focal_stack import WAVES, StackSpec, StackStore
from saf_gen.stream.defocus_blur import known_depth
from saf_gen.stream.stream_file import SpikeStream

F_NUMBER = 512.0
"""f-number of the point: a blur of 20 pixels at f/2 is then a twelfth of a pixel."""


@dataclass(frozen=True, eq=False)
class AllInFocus:
    """The all-in-focus picture of a recording of a scene at rest, on disk or still to be rendered.

    Attributes
    ----------
    capture : Capture
        The recording that can be captured again.
    spec : StackSpec
        Focal stack of the lens with a small aperture, at the two positions around the true focus.
    stacks : Path
        Folder of the stacks.
    """

    capture: Capture
    spec: StackSpec
    stacks: Path

    @classmethod
    def of_stream(cls, stream: SpikeStream, stacks: Path) -> "AllInFocus":
        """Return the picture of a stream, from the folder of the stacks that it was made from.

        Raises BadInput if the stream cannot be captured again from these stacks, if its scene moves, is a thin section
        or was photographed, if its lens has aberrations or a ring, or if its lamps have spectra.
        """
        where, position = str(stream.path), stream.truth.position
        known_depth(stream)
        capture = Capture.from_stream(stream, stacks)
        specs = capture.plane_source.time_stack.specs
        spec, drive = specs[0], specs[0].drive
        if spec.estimator == WAVES:
            raise BadInput(
                "its scene is a thin section, drawn by waves", where=where, allowed="scenes that light paths render"
            )
        if len(specs) > 1 or capture.colour is not None:
            raise BadInput("its lamps have spectra", where=where, allowed="light of one wavelength")
        if isinstance(drive, FittedLensDrive) or not drive.fills_its_aperture_perfectly:
            raise BadInput(
                "its lens has aberrations or a ring, which a point has not", where=where, allowed="perfect thin lenses"
            )
        first = int(np.clip(np.floor(position * (spec.positions - 1)), 0, spec.positions - 2))
        changes: dict[str, Any] = {"f_number": F_NUMBER}
        point = replace(drive, **changes)  # type: ignore[type-var]
        pinhole = replace(spec, drive=point, wavelength_m=0.0, window=(first, first + 1), margin=(0, 0))
        return cls(capture, pinhole, stacks)

    def load(self) -> np.ndarray:
        """Return the charge of each light group, float32 (light, row, col), in electrons per readout at gain 1.

        Raises BadInput if it was not rendered yet.
        """
        store = StackStore(self.stacks, self.spec)
        if missing := store.missing_pieces():
            raise BadInput(
                f"the all-in-focus picture {self.spec.key} lacks {', '.join(missing)}",
                where=str(self.stacks),
                hint="render it: saf_gen.render.all_in_focus.render_all_in_focus(stream, stacks)",
            )
        lens = self.capture.plane_source.time_stack.specs[0].drive  # whose aperture collects the light
        charge = charge_of_images(store.load_planes(0, 2), self.capture.sensor, lens=lens, position=self.spec.focus)
        weight = self.capture.truth.position * (self.spec.positions - 1) - self.spec.first_index
        between = charge[:, 0] + np.float32(np.clip(weight, 0, 1)) * (charge[:, 1] - charge[:, 0])
        return np.asarray(between * np.float32(self.capture.exposure), dtype=np.float32)


def load_all_in_focus(stream: SpikeStream, stacks: str | Path) -> np.ndarray:
    """Return the all-in-focus charge of a stream, from the folder of stacks in which it was rendered.

    Parameters
    ----------
    stream : SpikeStream
        Stream of a scene at rest that `saf-gen generate` made.
    stacks : str or Path
        Folder ``stacks`` of its dataset.

    Returns
    -------
    ndarray of float32, shape (light, row, col)
        Photo-electrons per readout at gain 1, without noise, at the scale of the depth map; its sum weighted with
        ``stream.gain[t]`` is what an all-in-focus lens would collect in readout t.

    Raises
    ------
    BadInput
        If it was not rendered yet, or if :meth:`AllInFocus.of_stream` refuses the stream.
    """
    return AllInFocus.of_stream(stream, Path(stacks)).load()
