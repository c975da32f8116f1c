import pytest
from handmade_evaluations import make_evaluation

from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.report import write_report


@pytest.fixture(scope="session")
def small_report(tmp_path_factory, drawing_figures):
    """The report of an evaluation made by hand, with its figures, for all who only read it: its folder and paths."""
    folder = tmp_path_factory.mktemp("report")
    made = make_evaluation()
    with drawing_figures():
        return folder, write_report(folder, evaluation=made, rows=rank_methods(made.records), title="small")
