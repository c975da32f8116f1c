"""A scene under test: its geometry, its true focus and its stacks, each computed when a check first needs it."""

from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np

from saf_gen.camera import Sensor, charge_of_images
from saf_gen.optics import Drive, FocusCriterion
from saf_gen.render import make_renderer
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import FocalStack

POSITIONS, SAMPLES = 65, 16  # over the whole travel
SLOW_POSITIONS, SLOW_SAMPLES = 17, 8
NEAR = 8  # positions on either side of the true focus, a quarter of the depth of focus apart
NEAR_SAMPLES = 16


@dataclass
class SceneUnderTest:
    """One member of a scene's family in front of a sensor.

    Accessing an attribute raises BadInput if it needs a part of the scene that cannot be built or seen.
    """

    scene: Scene
    sensor: Sensor
    _: KW_ONLY
    backend: str = "auto"

    @cached_property
    def renderer(self) -> SceneRenderer:
        """Renderer of the scene."""
        return make_renderer(self.scene, self.sensor, backend_name=self.backend, wavelength_m=self.sensor.wavelength_m)

    @property
    def drive(self) -> Drive:
        """Lens of the card, with its drive."""
        return self.scene.build_drive()

    @cached_property
    def depth_and_target(self) -> DepthAndTarget:
        """Depth map and target with the lens focused on the target; for a moving scene, at the time ``still_s``.

        Raises BadInput if the target is black.
        """
        seen = self.renderer.trace_geometry()
        self.renderer.require_own_light(seen)
        return seen

    @property
    def target_depths_m(self) -> np.ndarray:
        """Depths (m) of the target's pixels, float32 (pixel,)."""
        return self.depth_and_target.depth[self.depth_and_target.target]

    @property
    def in_focus(self) -> FocusCriterion:
        """What counts as in focus."""
        return FocusCriterion(self.drive, self.sensor.pitch_m, self.renderer.wavelength_m)

    @cached_property
    def true_focus(self) -> float:
        """Position of the lens at which the target is sharpest."""
        return self.in_focus.true_focus(self.depth_and_target.depth, self.depth_and_target.target)

    @cached_property
    def depth_of_focus(self) -> tuple[float, float]:
        """Positions of the lens at which the target's blur is as wide as what the camera resolves in focus."""
        return self.in_focus.depth_of_focus(self.depth_and_target.depth, self.depth_and_target.target)

    @property
    def half_depth_of_focus(self) -> float:
        """Half of the depth of focus, as a fraction of the travel, at most 0.25."""
        low, high = self.depth_of_focus
        return min((high - low) / 2, 0.25)

    @property
    def pixel_footprint_m(self) -> float:
        """Width (m) of the part of a plane facing the camera, at the true focus, that a pixel sees."""
        drive, focus = self.drive, self.true_focus
        return self.sensor.pitch_m * float(drive.object_distance(focus)) / float(drive.image_distance(focus))

    @cached_property
    def stack(self) -> FocalStack:
        """Coarse focal stack over the whole travel, with all lights together."""
        positions, samples = (SLOW_POSITIONS, SLOW_SAMPLES) if self.renderer.is_slow else (POSITIONS, SAMPLES)
        return self.renderer.render_stack(
            self.depth_and_target, positions=positions, samples=samples, as_one_group=True
        )

    @cached_property
    def near_stacks(self) -> tuple[FocalStack, FocalStack]:
        """Two stacks around the true focus with independent noise, so that their covariance is free of noise."""
        step = self.half_depth_of_focus / 2
        positions = round(1 / step) + 1
        middle = min(max(round(self.true_focus * (positions - 1)), 0), positions - 1)
        window = (max(middle - NEAR, 0), min(middle + NEAR, positions - 1))
        samples = SLOW_SAMPLES if self.renderer.is_slow else NEAR_SAMPLES
        first, second = (
            self.renderer.render_stack(
                self.depth_and_target, positions=positions, samples=samples, window=window, run=run
            )
            for run in (1, 2)
        )
        return first, second

    def collected_charge(self, stack: FocalStack) -> np.ndarray:
        """Return the photo-electrons per readout with all lights at gain 1, float32 (focus, row, col)."""
        return charge_of_images(stack.radiance, self.sensor, lens=self.drive, position=stack.spec.focus).sum(axis=0)
