"""The benches run and say what they measured; how fast is not for a test to say."""

import pytest

from saf_gen.bench import BENCHES, Figure, Size, run
from saf_gen.errors import BadInput
from saf_gen.render import variant

SMALL = Size(rows=20, columns=32, frames=400, positions=(3, 5), samples=4)


@pytest.mark.parametrize("name", BENCHES)
def test_a_bench_gives_figures_above_zero_with_unit_and_target(name):
    if name == "stack" and not variant.probe().llvm_usable:
        pytest.skip(variant.probe().llvm_in_words)
    figures = run([name], SMALL)
    assert len(figures) >= 5
    assert figures[-1].what == "peak memory"
    for figure in figures:
        assert figure.value > 0
        assert figure.unit
    assert any(figure.target is not None for figure in figures[:-1])


def test_a_target_is_met_on_its_own_side():
    assert Figure("b", "speed", 3.0, "x/s", 2.5).met is True
    assert Figure("b", "speed", 2.0, "x/s", 2.5).met is False
    assert Figure("b", "time", 0.4, "s", 0.5, at_most=True).met is True
    assert Figure("b", "size", 0.4, "bit").met is None


def test_an_unknown_bench_is_told_with_the_nearest():
    with pytest.raises(BadInput, match=r"unknown bench 'steam'; allowed: stack, stream; .*'stream'\?"):
        run(["steam"], SMALL)
