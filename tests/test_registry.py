"""Parts are found by name."""

import pytest

from saf_gen import registry
from saf_gen.errors import BadInput


def test_listing_a_room_names_its_files_and_no_helpers():
    assert {"constant", "ramp", "steps", "sine"} <= set(registry.names("lights"))
    assert not any(name.startswith("_") for room in registry.ROOMS for name in registry.names(room))


def test_every_registered_part_is_one_dataclass_with_a_docstring():
    for room in registry.ROOMS:
        for name in registry.names(room):
            assert registry.part_class(room, name).__doc__, f"{room}/{name}"


def test_a_trailing_underscore_is_no_part_of_a_key():
    assert registry.keys("lights", "ramp") == {"from": "from_", "to": "to", "over_s": "over_s"}


def test_an_unknown_part_is_told_with_the_nearest():
    with pytest.raises(BadInput, match=r"unknown light schedule 'rampp'; .*did you mean 'ramp'\?"):
        registry.build("lights", "rampp")


def test_an_unknown_key_is_told_with_the_nearest():
    with pytest.raises(BadInput, match=r"'ramp': 'form'; allowed: from, over_s, to; did you mean 'from'\?"):
        registry.build("lights", "ramp", form=1)


def test_a_missing_key_is_told_with_the_keys():
    with pytest.raises(BadInput, match=r"light schedule 'ramp': .*missing.*; allowed: from, to, over_s"):
        registry.build("lights", "ramp", to=2)
