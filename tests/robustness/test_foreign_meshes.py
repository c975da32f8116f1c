"""A mesh as others store it looks as its file says, or a line says what is missing, or it is refused."""

import foreign_meshes
import pytest


@pytest.mark.parametrize("count", [12, pytest.param(300, marks=pytest.mark.long)])
def test_no_foreign_mesh_looks_wrong_in_silence(count):
    found, faults = foreign_meshes.run(count, 5)
    assert faults == []
    assert sum(found.values()) == count
