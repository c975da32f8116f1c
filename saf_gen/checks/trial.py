"""A scene on the bench: its geometry, its true focus and its stacks, each made when a check first asks."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from saf_gen.camera import Sensor, charge_stack
from saf_gen.focal_stack import FocalStack
from saf_gen.optics import Drive
from saf_gen.render.film import Film
from saf_gen.render.geometry import Geometry
from saf_gen.render.studio import Studio
from saf_gen.scene import Scene

__all__ = ["Trial"]

POSITIONS, SAMPLES = 65, 16  # of the whole travel
SLOW_POSITIONS, SLOW_SAMPLES = 17, 8
NEAR = 8  # positions to either side of the truth, half of a half depth of focus apart
NEAR_SAMPLES = 16


@dataclass
class Trial:
    """One member of a scene's family before a sensor.

    Raises BadInput, on the first use of what it concerns, where the scene cannot be built or seen.
    """

    scene: Scene
    sensor: Sensor
    variant: str = "auto"

    @cached_property
    def studio(self) -> Studio:
        """The scene, built."""
        film = Film(self.sensor.rows, self.sensor.columns, self.sensor.pitch_m)
        return Studio(self.scene, film, variant_name=self.variant)

    @property
    def drive(self) -> Drive:
        """The card's lens."""
        return self.scene.drive()

    @cached_property
    def seen(self) -> Geometry:
        """Depth and target where the target is in focus; of a scene that moves, at ``still_s``."""
        return self.studio.look()

    @property
    def depths(self) -> np.ndarray:
        """Depth (m) of the target's pixels, float32 (pixel,)."""
        return self.seen.depth[self.seen.target]

    @cached_property
    def truth(self) -> float:
        """The position that is sharpest by optics."""
        return self.drive.truth(self.depths)

    @cached_property
    def depth_of_focus(self) -> tuple[float, float]:
        """The positions at which the target's blur is one pixel."""
        return self.drive.depth_of_focus(self.depths, self.sensor.pitch_m)

    @property
    def half_depth(self) -> float:
        """Half of the depth of focus, as a share of the travel; at most a quarter of the travel."""
        low, high = self.depth_of_focus
        return min((high - low) / 2, 0.25)

    @property
    def footprint_m(self) -> float:
        """What a pixel sees (m) of a plane that faces it where the target is in focus."""
        u, v = (float(of(self.truth)) for of in (self.drive.object_distance, self.drive.image_distance))
        return self.sensor.pitch_m * u / v

    @cached_property
    def stack(self) -> FocalStack:
        """The whole travel, coarse."""
        slow = self.studio.is_slow
        positions, samples = (SLOW_POSITIONS, SLOW_SAMPLES) if slow else (POSITIONS, SAMPLES)
        return self.studio.stack(self.seen, positions=positions, samples=samples, together=True)

    @cached_property
    def near(self) -> tuple[FocalStack, FocalStack]:
        """Two stacks round the truth, their noise independent: what they share is the picture."""
        step = self.half_depth / 2
        positions = round(1 / step) + 1
        middle = min(max(round(self.truth * (positions - 1)), 0), positions - 1)
        window = (max(middle - NEAR, 0), min(middle + NEAR, positions - 1))
        samples = SLOW_SAMPLES if self.studio.is_slow else NEAR_SAMPLES
        first, second = (
            self.studio.stack(self.seen, positions=positions, samples=samples, window=window, run=run)
            for run in (1, 2)
        )
        return first, second

    def charge(self, stack: FocalStack) -> np.ndarray:
        """Photo-electrons a readout at gain 1 of all lights, float32 (focus, row, col)."""
        drive = self.drive
        by_group = charge_stack(
            stack.radiance,
            drive.image_distance(stack.spec.focus),
            drive.aperture_radius_m,
            self.sensor,
            transmission=drive.transmission,
        )
        return by_group.sum(axis=0)
