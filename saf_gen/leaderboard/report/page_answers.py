"""The answers that the page holds: all answers of a small evaluation, or a selection from a large one."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from saf_gen.benchmark.records import Record

MAX_ANSWERS = 100
"""Largest number of rows in the table of single answers, with and without the script."""
MAX_HELD = 5000
"""Number of answers above which the page holds only a selection for its script, so that its size stays limited."""
WORST_OF_METHOD = 20


@dataclass(frozen=True)
class HeldAnswers:
    """The answers in the page, the worst first, and their sequences.

    Attributes
    ----------
    lines : tuple of (int, Record)
        Line of each record in ``records.jsonl``, counted from 1, and the record.
    sequences : tuple of str
        Names of the sequences. The first ``compared`` of them have the answers of every method.
    compared : int
        Number of sequences that have the answers of every method.
    total : int
        Number of all sequences of the evaluation.
    """

    lines: tuple[tuple[int, Record], ...]
    sequences: tuple[str, ...]
    compared: int
    total: int

    @property
    def are_all(self) -> bool:
        """Whether every answer is in the page."""
        return self.compared == self.total


def choose_answers_for_report(records: Sequence[Record], *, max_answers: int = MAX_HELD) -> HeldAnswers:
    """Return the answers that the page holds, the worst first.

    If there are at most ``max_answers`` answers, all are held. Otherwise the page holds the answers of every method on
    sequences that are spread evenly over all, the MAX_ANSWERS worst answers of all, and the WORST_OF_METHOD worst of
    each method, or fewer if there are many methods, so that at most about twice ``max_answers`` are held.
    """
    names = list(dict.fromkeys(record.sequence for record in records))
    methods = len({record.method for record in records})
    sizes = [inf if record.error_dof is None else abs(record.error_dof) for record in records]
    worst_first = sorted(range(len(records)), key=lambda at: -sizes[at])
    compared, worst = names, set(worst_first[:MAX_ANSWERS])
    if len(records) > max_answers:
        count = max(1, max_answers // methods)
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
