"""A frame at random: a search that looks at nothing, as a row for guessing."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.core.seeds import make_generator
from saf_gen.parts import Answer, View

SEEDING = 20
"""The first one in so many frames of a recording seeds the draw."""


@dataclass(frozen=True)
class Anywhere:
    """Answers with a frame of the recording at random, whatever it shows: the row that a table needs for guessing.

    A search does not know the name of a recording. The counts in its first twentieth seed the draw, so
    that the answer repeats on the same recording and is independent between recordings; a method below this row has
    not found the focus. ``middle`` guesses better where recipes put the focus near the middle of the travel.

    The search takes no score, so it does not matter which measure precedes it. It asks for the counts of the frame
    that it draws, so that the sweep of a closed loop comes as far, and does not look at them. The trace is empty.

    References
    ----------
    This project.
    """

    causal: ClassVar[bool] = True

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording."""
        first = np.ascontiguousarray(view.counts(0, max(1, view.frames // SEEDING)), dtype="<u4")
        random = make_generator("anywhere", first.tobytes().hex())
        frame = int(random.integers(view.frames))
        view.counts(frame, frame + 1)
        return Answer(float(frame))
