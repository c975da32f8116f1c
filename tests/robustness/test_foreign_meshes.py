"""A mesh as strangers store it looks as its file says, or a line says what is missing, or it is refused."""

import foreign_meshes
import pytest


@pytest.mark.parametrize("count", [12, pytest.param(200, marks=pytest.mark.long)])
def test_no_mesh_of_a_stranger_looks_wrong_in_silence(count):
    found, faults = foreign_meshes.run(count, 5)
    assert faults == []
    assert sum(found.values()) == count
