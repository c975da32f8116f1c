"""Files as strangers store them are read as they are, or asked about; with options that say how, all are read."""

import foreign_files
import pytest


@pytest.mark.parametrize("count", [pytest.param(20, marks=pytest.mark.slow), pytest.param(500, marks=pytest.mark.long)])
def test_no_file_of_a_stranger_is_read_wrongly(count):
    """Seed 3. Of the files that show how they are stored, 95 in 100 are read without an option."""
    found, faults = foreign_files.run(count, 3)
    assert faults == []
    unasked = {
        verdict: sum(found[c, "unasked", verdict] for c in foreign_files.TEXTURED) for verdict in ("read", "asked")
    }
    assert unasked["read"] >= 0.9 * sum(unasked.values())
