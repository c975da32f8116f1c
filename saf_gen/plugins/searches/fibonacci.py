"""Fibonacci search with the lens."""

from dataclasses import dataclass

from saf_gen.plugins.searches._lens_commanding import BracketingSearch, FocusSampler


@dataclass(frozen=True)
class Fibonacci(BracketingSearch):
    """Fibonacci search: golden section on F equal parts of the travel, F a Fibonacci number.

    The positions are k/F, k = 1 ... F − 1; the answer is one of them, and a single peak lies between its two
    neighbours: 2/F is no more than ``tolerance``. In the worst case no other search finds the best of so many
    positions with so few samples: n samples take F = F(n + 2) (1, 1, 2, 3, 5 ...), 11 for a tolerance of
    0.01. Noise misleads it as it does golden section. Of equal samples the later position is dropped.

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
        # The bracket is left ... left + numbers[k] parts; both positions are numbers[k − 2] from its ends.
        lower, upper = (sample(numbers[k] / parts) for k in (-3, -2))
        for k in range(len(numbers) - 2, 1, -1):
            if lower >= upper:
                lower, upper = sample((left + numbers[k - 2]) / parts), lower
            else:
                left += numbers[k - 1]
                lower, upper = upper, sample((left + numbers[k - 1]) / parts)
        return ""
