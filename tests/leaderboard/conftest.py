import pytest
from handmade_evaluations import make_delivered, make_evaluation

from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.report import write_report


@pytest.fixture(scope="session")
def small_report(tmp_path_factory):
    """Folder and paths of the report of a handmade evaluation. Do not change it."""
    folder = tmp_path_factory.mktemp("report")
    made = make_evaluation()
    rows = rank_methods(made.records)
    return folder, write_report(folder, evaluation=made, rows=rows, title="small", delivered=make_delivered())
