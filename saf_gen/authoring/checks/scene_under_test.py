"""A scene on the bench: its geometry, its true focus and its stacks, each made when a check first asks."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from saf_gen.camera import Sensor, charge_stack
from saf_gen.optics import Drive
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.focal_stack import FocalStack

__all__ = ["SceneUnderTest"]

POSITIONS, SAMPLES = 65, 16  # of the whole travel
SLOW_POSITIONS, SLOW_SAMPLES = 17, 8
NEAR = 8  # positions to either side of the truth, half of a half depth of focus apart
NEAR_SAMPLES = 16


@dataclass
class SceneUnderTest:
    """One member of a scene's family before a sensor.

    Raises BadInput, on the first use of what it concerns, where the scene cannot be built or seen.
    """

    scene: Scene
    sensor: Sensor
    backend: str = "auto"

    @cached_property
    def renderer(self) -> SceneRenderer:
        """The scene, built."""
        return SceneRenderer(self.scene, self.sensor, backend_name=self.backend)

    @property
    def drive(self) -> Drive:
        """The card's lens."""
        return self.scene.build_drive()

    @cached_property
    def depth_and_target(self) -> DepthAndTarget:
        """Depth and target where the target is in focus; of a scene that moves, at ``still_s``."""
        return self.renderer.trace_depth_and_target()

    @property
    def target_depths_m(self) -> np.ndarray:
        """Depth (m) of the target's pixels, float32 (pixel,)."""
        return self.depth_and_target.depth[self.depth_and_target.target]

    @cached_property
    def true_focus(self) -> float:
        """The position that is sharpest by optics."""
        return self.drive.true_focus(self.target_depths_m)

    @cached_property
    def depth_of_focus(self) -> tuple[float, float]:
        """The positions at which the target's blur is one pixel."""
        return self.drive.depth_of_focus(self.target_depths_m, self.sensor.pitch_m)

    @property
    def half_depth_of_focus(self) -> float:
        """Half of the depth of focus, as a share of the travel; at most a quarter of the travel."""
        low, high = self.depth_of_focus
        return min((high - low) / 2, 0.25)

    @property
    def pixel_footprint_m(self) -> float:
        """What a pixel sees (m) of a plane that faces it where the target is in focus."""
        u, v = (float(of(self.true_focus)) for of in (self.drive.object_distance, self.drive.image_distance))
        return self.sensor.pitch_m * u / v

    @cached_property
    def stack(self) -> FocalStack:
        """The whole travel, coarse."""
        slow = self.renderer.is_slow
        positions, samples = (SLOW_POSITIONS, SLOW_SAMPLES) if slow else (POSITIONS, SAMPLES)
        return self.renderer.render_stack(
            self.depth_and_target, positions=positions, samples=samples, together=True
        )

    @cached_property
    def near_stacks(self) -> tuple[FocalStack, FocalStack]:
        """Two stacks round the truth, their noise independent: what they share is the picture."""
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
        """Photo-electrons a readout at gain 1 of all lights, float32 (focus, row, col)."""
        by_group = charge_stack(stack.radiance, self.sensor, lens=self.drive, position=stack.spec.focus)
        return by_group.sum(axis=0)
