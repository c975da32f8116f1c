"""What the page says over its figures and tables."""

__all__ = ["FIGURE_CAPTIONS", "MEASURES_CAPTION"]

FIGURE_CAPTIONS = {
    "errors": (
        "Errors",
        "Each method's answer against the truth, a mark for each sequence. The yellow band is success within "
        "one depth of focus.",
    ),
    "curves": (
        "Focus curves",
        "Every measure by its own minimum and maximum. Grey: the light, as mean counts. Yellow: the depth of "
        "focus round the true focus. On top: what each search answered with each measure. A curve that "
        "follows the grey area follows the light, not the focus. Where there are pictures, each shows the "
        "counts of a piece of the sweep; the frame in it is where measures look.",
    ),
    "sweep": (
        "Sweeps",
        "No method looked at a whole curve of these, as the search argmax does. Grey: the light, as mean "
        "counts. Yellow: the depth of focus round the true focus. On top: what each search answered with "
        "each measure. Where there are pictures, each shows the counts of a piece of the sweep; the frame "
        "in it is where measures look.",
    ),
    "steps": (
        "Steps of the searches",
        "The place that a search looked round, step by step, against the true focus.",
    ),
    "lens": (
        "Way of the lens",
        "Where methods took the lens, against the true focus. A line ends where the lens was judged; a cross "
        "marks a method that failed.",
    ),
    "light-ratio": (
        "Against the light's ratio",
        "Sequences in order of how much the light changed. Above, the share within one depth of focus; "
        "below, the median error. Dots are single answers.",
    ),
    "photon-budget": (
        "Against the photon budget",
        "Sequences in order of mean counts a pixel in a block of 100 readouts, drawn in the same way.",
    ),
}
"""By kind of figure: a heading and what it shows."""
MEASURES_CAPTION = (
    "How good the curve of each measure is, whatever searches it: medians over the sequences. The criteria "
    "are those of microscopy; curves.csv has every sequence."
)
