"""Name of the frozen benchmark that a recording belongs to."""

from collections.abc import Mapping

from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY, read_frozen_digests

_DIGITS = 12
"""Number of digits of the digest that a record contains."""


def benchmark_of(provenance: Mapping[str, str]) -> str | None:
    """Return the name of a recording's frozen benchmark and 12 digits of its digest, or None if it belongs to none.

    The benchmark that a recording states is accepted only if this version of saf_gen knows its name and digest.
    """
    name, _, digest = provenance.get(BENCHMARK_KEY, "").partition(" ")
    frozen = read_frozen_digests().get(name)
    return f"{name} {digest[:_DIGITS]}" if frozen is not None and digest == frozen.digest else None
