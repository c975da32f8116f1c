"""The middle of a recording: a search that looks at nothing, as a row for guessing."""

from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer, View


@dataclass(frozen=True)
class Middle:
    """Answers with the middle of the recording, whatever it shows: the row that a table needs for guessing.

    A travel of 8 depths of focus gives a constant answer within one of them a quarter of the time if the focus may be
    anywhere, and more if recipes put it near the middle. A method below this row has not found the focus.

    The search takes no score, so it does not matter which measure precedes it. It asks for the counts of the middle
    frame, so that the sweep of a closed loop comes as far, and does not look at them. The trace is empty.

    References
    ----------
    This project.
    """

    causal: ClassVar[bool] = True

    def __call__(self, view: View) -> Answer:
        """Return the answer for a recording."""
        middle = view.frames // 2
        view.counts(middle, middle + 1)
        return Answer((view.frames - 1) / 2)
