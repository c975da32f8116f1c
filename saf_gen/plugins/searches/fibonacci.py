"""Fibonacci search, which moves the lens."""

from dataclasses import dataclass

from saf_gen.plugins.searches._lens_commanding import BracketingSearch, FocusSampler


@dataclass(frozen=True)
class Fibonacci(BracketingSearch):
    """Fibonacci search: golden section on a travel divided into F equal parts, with F a Fibonacci number.

    The positions are k/F, k = 1 ... F − 1. The answer is one of them, and a single peak is between its two neighbours,
    which are 2/F apart, at most ``tolerance``. In the worst case, no other search finds the best of that many positions
    with fewer samples: n samples suffice for F = F(n + 2) (1, 1, 2, 3, 5 ...), so a tolerance of 0.01 takes 11 samples.
    Noise misleads this search as it does golden section. If two samples are equal, the larger position is dropped.

    References
    ----------
    .. [1] Kiefer, Proc. American Mathematical Society 4(3), 1953, doi:10.1090/S0002-9939-1953-0055639-3.
    .. [2] For focusing: Krotkov, International J. Computer Vision 1(3), 1988, doi:10.1007/BF00127822.
    """

    def seek_focus(self, sample: FocusSampler) -> str:
        numbers = [1, 2, 3]
        while numbers[-1] * self.tolerance < 2:
            numbers.append(numbers[-1] + numbers[-2])
        parts, left = numbers[-1], 0
        # The bracket is left ... left + numbers[k] parts; the two positions are numbers[k − 2] parts from its ends.
        lower, upper = (sample(numbers[k] / parts) for k in (-3, -2))
        for k in range(len(numbers) - 2, 1, -1):
            if lower >= upper:
                lower, upper = sample((left + numbers[k - 2]) / parts), lower
            else:
                left += numbers[k - 1]
                lower, upper = upper, sample((left + numbers[k - 1]) / parts)
        return ""
