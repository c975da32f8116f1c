"""Which frozen benchmark a recording belongs to."""

from collections.abc import Mapping

from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY, read_frozen_benchmarks

_DIGITS = 12
"""Of the digest, in a record."""


def name_benchmark_for_record(provenance: Mapping[str, str]) -> str | None:
    """Return the name of a recording's frozen benchmark and 12 digits of its digest; None where it belongs to none.

    What a recording claims counts where this version knows a benchmark of that name and digest.
    """
    name, _, digest = provenance.get(BENCHMARK_KEY, "").partition(" ")
    frozen = read_frozen_benchmarks().get(name)
    return f"{name} {digest[:_DIGITS]}" if frozen is not None and digest == frozen.digest else None
