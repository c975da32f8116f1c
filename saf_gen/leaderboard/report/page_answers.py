"""The single answers that the page holds: all of a small evaluation, and of a large one as many as stay readable."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from saf_gen.benchmark.records import Record

MAX_ANSWERS = 100
"""Most rows in the table of single answers, with and without the script."""
MAX_HELD = 5000
"""Most answers that the page holds for its script, so that it does not grow with the sequences."""
WORST_OF_METHOD = 20


@dataclass(frozen=True)
class HeldAnswers:
    """The answers in the page, the worst first, and the sequences that they are of.

    Attributes
    ----------
    lines : the number of each record in ``records.jsonl``, from 1, with the record.
    sequences : names; the first ``compared`` of them have the answers of every method.
    total : how many sequences there are.
    """

    lines: tuple[tuple[int, Record], ...]
    sequences: tuple[str, ...]
    compared: int
    total: int

    @property
    def are_all(self) -> bool:
        """Whether every answer is in the page."""
        return self.compared == self.total


def choose_answers_for_report(records: Sequence[Record], *, most: int = MAX_HELD) -> HeldAnswers:
    """Return all answers, the worst first, or of more than ``most`` those of sequences spread evenly over them all.

    Beside these are then the MAX_ANSWERS worst of all, and WORST_OF_METHOD of each method, or fewer where there are
    many methods, so that with them twice ``most`` are held.
    """
    names = list(dict.fromkeys(record.sequence for record in records))
    methods = len({record.method for record in records})
    sizes = [inf if record.error_dof is None else abs(record.error_dof) for record in records]
    worst_first = sorted(range(len(records)), key=lambda at: -sizes[at])
    compared, worst = names, set(worst_first[:MAX_ANSWERS])
    if len(records) > most:
        count = max(1, most // methods)
        compared = [names[i * len(names) // count] for i in range(count)]
        of_method: Counter[str] = Counter()
        for at in worst_first:
            if of_method[records[at].method] < min(WORST_OF_METHOD, count):
                of_method[records[at].method] += 1
                worst.add(at)
    chosen = set(compared)
    held = [at for at in worst_first if at in worst or records[at].sequence in chosen]
    sequences = tuple(dict.fromkeys([*compared, *(records[at].sequence for at in held)]))
    return HeldAnswers(tuple((at + 1, records[at]) for at in held), sequences, len(compared), len(names))
