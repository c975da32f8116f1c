"""The captions of the page's figures and tables."""

_SWEEP = (
    "Grey: the light, as mean counts. Yellow: the depth of focus round the true focus. On top: the "
    "answers of each search with each measure. Pictures show a part of the sweep each: TFP counts its spikes, "
    "TFI takes the time between two spikes in its middle, spikes is one readout of a piece of the sensor, magnified. "
    "The frame is where measures look."
)
OPENING_CAPTION = (
    "The width of the target's blur over the distance of the lens from the true focus: inside the yellow band it is at"
    " most a pixel."
)
OPENING_PICTURES = (
    "Above it, a detail of the target as the camera saw it at the dots, and their distances in depths of focus."
)
FIGURE_CAPTIONS = {
    "curves": (
        "Focus curves",
        "Every measure by its own minimum and maximum. A curve that follows the grey area follows the "
        f"light, not the focus. {_SWEEP}",
    ),
    "sweep": ("Sweeps", f"No method computed a whole curve of these, as the search argmax does. {_SWEEP}"),
    "errors": (
        "Errors",
        "Answer minus truth of each method, a mark per sequence; of many their median, with a line over the middle "
        "90 %. The yellow band is success within one depth of focus.",
    ),
    "steps": ("Steps of the searches", "The position that a search examined, step by step, against the true focus."),
    "lens": (
        "Path of the lens",
        "Where methods moved the lens, against the true focus. A line ends where the lens was judged; "
        "a cross marks a method that failed.",
    ),
    "profile": (
        "Performance profiles",
        "How many answers lie within each limit: a method is better where its line is higher. Bands, of the first"
        " three methods, are 95 % intervals of each point alone; profiles.csv has all. The line at"
        " one depth of focus is what ranks.",
    ),
    "neighbours": (
        "Probability of improvement",
        "How often the upper of two neighbours in rank is nearer to the truth on a sequence, ties counted half, with"
        " 95 % intervals of each pair alone. A half is no improvement; rank goes by success, so it may be less.",
    ),
    "light-ratio": (
        "Against the light ratio",
        "Sequences in order of how much the light changed: success within one depth of focus above, "
        "median error below. Dots are single answers.",
    ),
    "photon-budget": (
        "Against the photon budget",
        "Sequences in order of mean counts per pixel in a block of 100 readouts, drawn in the same manner.",
    ),
}
"""By kind of figure: a heading and what the figures show."""
NEIGHBOUR_CAPTION = (
    "Methods that follow each other in rank: their difference in success within 1 DoF, and the probability that the"
    " first is nearer to the truth on a sequence, with 95 % intervals of each pair alone. Told apart: whether the"
    " difference is too large for chance among all neighbours together."
)
AGREEMENT_CAPTION = (
    "How far the ranking hangs on a condition: Kendall's τ of the rankings under two of its bins is 1 where both order"
    " the methods alike. Beside it stand its interval over scenes, what it would be by chance if the condition changed"
    " nothing, and how often it would then be as low (p, of this pair alone)."
)
GRAIN_CAPTION = (
    "Noise that the renderer left in the pictures: its root mean square over the mean in the box round the target, at"
    " best focus, and its largest energy over the range of each measure's focus curve. Above a tenth it may move the"
    " peak of the curve. Only measures whose energy recordings state are here."
)
MEASURES_CAPTION = (
    "Quality of the focus curve of each measure, whatever searches it: medians over the sequences. The"
    " criteria are those of microscopy; curves.csv has every sequence."
)
