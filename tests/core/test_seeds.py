"""Random streams are named by purpose."""

import numpy as np

from saf_gen.core import seeds


def test_a_name_gives_the_same_numbers_again():
    assert np.array_equal(seeds.make_generator(7, "a").random(5), seeds.make_generator(7, "a").random(5))


def test_names_are_hashed_as_lists_not_joined():
    assert seeds.derive_seed("a", "bc") != seeds.derive_seed("ab", "c")
    assert seeds.derive_seed("1") != seeds.derive_seed(1)


def test_the_stream_of_a_purpose_is_fixed_for_good():
    # Pinned values, so that a dataset can be made again in later years.
    assert seeds.derive_seed("sequence", 7) == 1766924209584151614
    assert int(seeds.make_generator("sequence", 7).integers(2**62)) == 1691169232200190960
