import pytest
from handmade_evaluations import make_evaluation

from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.report import write_report


@pytest.fixture(scope="session")
def small_report(tmp_path_factory, drawing_figures):
    """Folder and paths of the report of a handmade evaluation, with its figures. Do not change it."""
    folder = tmp_path_factory.mktemp("report")
    made = make_evaluation()
    with drawing_figures():
        return folder, write_report(folder, evaluation=made, rows=rank_methods(made.records), title="small")
