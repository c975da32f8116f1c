"""Captions of the figures and tables of the page."""

from saf_gen.leaderboard.axes import BLOCK_READOUTS

_SWEEP = (
    "Grey: the light, as mean counts. Yellow: the depth of focus around the true focus. At the top: the "
    "answers of each search with each measure. Each picture shows a part of the sweep: TFP counts its spikes, TFI "
    "shows the time between two spikes in its middle, and spikes is one readout of a part of the sensor, magnified. "
    "Measures look inside the outlined box."
)
OPENING_CAPTION = (
    "Width of the target's blur against the distance of the lens from the true focus. Inside the yellow band the blur"
    " is at most one pixel wide."
)
OPENING_PICTURES = (
    "Above: a detail of the target as the camera saw it at the dots, with their distances in depths of focus."
)
FIGURE_CAPTIONS = {
    "curves": (
        "Focus curves",
        "The curve of each measure, scaled by its minimum and maximum. A curve that follows the grey area follows the "
        f"light, not the focus. {_SWEEP}",
    ),
    "sweep": ("Sweeps", f"No method computed a complete focus curve of these, as the search argmax would. {_SWEEP}"),
    "errors": (
        "Errors",
        "Answer minus truth of each method, with one mark per sequence; if there are many, a mark shows their median "
        "and a line the middle 90 %. The yellow band is success within one depth of focus.",
    ),
    "steps": ("Steps of the searches", "The position that a search examined at each step, and the true focus."),
    "lens": (
        "Path of the lens",
        "The position of the lens over time, and the true focus. A line ends where the lens was judged; "
        "a cross marks a method that failed.",
    ),
    "profile": (
        "Performance profiles",
        "Fraction of answers within each limit: a higher line is better. The bands, for the first three methods, are"
        " 95 % intervals of each point alone; profiles.csv has them for all methods. Methods are ranked by their"
        " fractions at the line at one depth of focus.",
    ),
    "neighbours": (
        "Probability of improvement",
        "Probability that the upper of two neighbours in rank is nearer to the truth on a sequence (ties count"
        " half), with 95 % intervals of each pair alone. One half means no improvement; because methods are ranked by"
        " success, the probability may be lower.",
    ),
    "light-ratio": (
        "Against the light ratio",
        "Success within one depth of focus (above) and median error (below) against the light ratio "
        "(brightest divided by darkest light). Dots are single answers.",
    ),
    "photon-budget": (
        "Against the photon budget",
        "Success within one depth of focus (above) and median error (below) against the mean counts per pixel in a "
        f"block of {BLOCK_READOUTS} readouts. Dots are single answers.",
    ),
}
"""Heading and caption of each kind of figure."""
NEIGHBOUR_CAPTION = (
    "Methods that follow each other in rank: their difference in success within 1 DoF, and the probability that the"
    " first is nearer to the truth on a sequence, with 95 % intervals of each pair alone. Told apart: whether the"
    " difference is too large for chance, among all pairs at once."
)
AGREEMENT_CAPTION = (
    "How much the ranking depends on a condition: Kendall's τ of the rankings under two of its bins is 1 if both order"
    " the methods alike. The table also gives the interval of τ over scenes, the τ to expect if the condition had no"
    " effect, and the probability that τ would then be as low (p, for this pair alone)."
)
GRAIN_CAPTION = (
    "Noise that the renderer left in the pictures: its root mean square divided by the mean, in the box around the"
    " target at best focus, and its largest energy divided by the range of each measure's focus curve. An energy above"
    " a tenth of the range may move the peak of the curve. Only measures for which the recordings state this energy are"
    " listed."
)
MEASURES_CAPTION = (
    "Quality of the focus curve of each measure, regardless of the search: medians over the sequences. The"
    " criteria are common in microscopy; curves.csv has every sequence."
)
