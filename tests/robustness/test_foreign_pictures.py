"""Pictures as strangers store them are read as they are, refused if damaged, and read with options that say how."""

import foreign_pictures
import pytest


@pytest.mark.slow
@pytest.mark.parametrize("count", [20, pytest.param(500, marks=pytest.mark.long)])
def test_no_picture_of_a_stranger_is_read_wrongly(count):
    """Seed 1."""
    found, faults = foreign_pictures.run(count, 1)
    assert faults == []
    assert sum(found[kind, "with options", "read"] for kind in foreign_pictures.KINDS) >= 0.7 * count
