"""The option ``reject`` of every search: it abstains where ``peak_fit`` would, and changes nothing unless given."""

import numpy as np
import pytest
from ideal_camera import IdealCamera, bell_curve
from lit_sweep import Sweep
from refusals import refusal

from saf_gen import get_search
from saf_gen.benchmark.conformance import check_search
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.parts import commands, wants_polarities
from saf_gen.plugins.searches import search_names

FRAMES = 4000
ESTIMATING = [name for name in search_names() if not commands(s := get_search(name)) and not wants_polarities(s)]
"""Searches that estimate on the sweeps here, which are of spikes."""
ANSWER_ANYTHING = ["argmax", "egs", "egs_code", "naive", "sgfs_causal", "sgfs_code"]


def sweep(first, last, *, at=0.5, width=0.06, **options):
    lens = np.linspace(first, last, FRAMES)
    bells = [0.4 / (1 + ((lens - at) / w) ** 2) for w in (width, 0.3)]
    return Sweep(bells[0], lens=lens, broad=bells[1], noise=0.01, **options)


@pytest.mark.parametrize("name", ESTIMATING)
@pytest.mark.parametrize(("first", "last"), [(0.0, 1.0), (1.0, 0.1)])
def test_a_focus_in_the_sweep_keeps_its_answer(name, first, last):
    plain, rejecting = (get_search(name, **options)(sweep(first, last)) for options in ({}, {"reject": True}))
    assert (rejecting.frame, rejecting.trace) == (plain.frame, plain.trace)


@pytest.mark.parametrize("name", ANSWER_ANYTHING)
@pytest.mark.parametrize(("first", "last"), [(0.0, 0.3), (1.0, 0.7)], ids=["before the focus", "beyond it"])
def test_a_sweep_that_ends_far_from_the_focus_has_no_answer(name, first, last):
    assert get_search(name)(sweep(first, last)).frame is not None
    answer = get_search(name, reject=True)(sweep(first, last))
    assert answer.frame is None
    assert answer.note.startswith("rejected: ")


@pytest.mark.daily(20)
@pytest.mark.parametrize("name", ESTIMATING)
@pytest.mark.parametrize("last", [0.3, 0.42, 0.46, 0.49, 0.52, 0.56, 0.7])
def test_nobody_abstains_where_peak_fit_answers(name, last):
    ours, plain = get_search("peak_fit")(sweep(0, last)), get_search(name)(sweep(0, last))
    answer = get_search(name, reject=True)(sweep(0, last))
    assert answer.frame == (None if ours.frame is None else plain.frame)


@pytest.mark.parametrize("name", ["golden_section", "fibonacci", "hill_climb", "rule_based", "coarse_to_fine"])
def test_a_lens_that_is_moved_to_an_end_has_no_answer(name):
    def camera(peak):
        return IdealCamera(bell_curve(peak), start=0.5, others={"sd": bell_curve(peak, width=0.25)})

    inside, outside = (get_search(name, reject=True)(camera(peak)) for peak in (0.4, 1.2))
    assert inside.position == get_search(name)(camera(0.4)).position
    assert (outside.position, outside.note) == (None, "rejected: the samples have no two sides")


def test_a_short_recording_is_judged_in_steps_of_two_frames():
    values = 1 / (1 + ((np.arange(300) - 150) / 20) ** 2)
    view = Sweep(values, light=np.full(300, 0.5), lens=np.linspace(0, 1, 300), broad=values)
    assert get_search("argmax", window=10, reject=True)(view).frame == get_search("argmax", window=10)(view).frame


def test_without_the_option_the_code_and_the_name_of_a_method_stay():
    plain = parse_method("sd+argmax")
    assert parse_method("sd+argmax:reject=false").code == plain.code
    assert parse_method("sd+argmax:reject=true").code != plain.code
    assert parse_method("sd+argmax:reject=true,window=50").search_options == {
        **parse_method("sd+argmax:window=50").search_options,
        "reject": True,
    }


@pytest.mark.parametrize("value", [1, 0.03, "yes", "peak_fit", None])
def test_the_option_is_true_or_false(value):
    assert "true or false" in str(refusal(get_search, "argmax", reject=value))


def test_a_misspelt_option_is_told_its_nearest():
    assert "reject" in str(refusal(get_search, "argmax", rejct=True))


@pytest.mark.slow
@pytest.mark.daily(1)
@pytest.mark.parametrize("name", ["argmax", "egs_code", "golden_section"])
def test_it_passes_the_checks_of_a_search(name):
    assert [one for one in check_search(get_search(name, reject=True)) if one.level == "error"] == []
