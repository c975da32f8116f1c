"""Files of other programs are read as they are stored, or refused; with options that say how, all are read."""

import foreign_files
import pytest


@pytest.mark.parametrize("count", [pytest.param(30, marks=pytest.mark.slow), pytest.param(600, marks=pytest.mark.long)])
def test_no_file_of_another_program_is_read_wrongly(count):
    """Seed 3. None is read without an option: none of these formats says how it is stored."""
    assert foreign_files.run(count, 3)[1] == []
