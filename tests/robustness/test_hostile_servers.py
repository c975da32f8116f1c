"""No server and no dataset of a stranger is more than one line."""

import pytest
from hostile_servers import run


@pytest.mark.slow
@pytest.mark.parametrize("count", [30, pytest.param(200, marks=pytest.mark.long)])
def test_hostile_servers_and_datasets_are_refused_or_read_right(count):
    """Seed 5; the hostile answers that take their time are tried in the long run."""
    said = []
    totals = run(count, seed=5, say=said.append)
    assert said == []
    assert totals["refused"] > count
