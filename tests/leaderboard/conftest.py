import pytest
from handmade_evaluations import make_delivered, make_evaluation

from saf_gen.leaderboard import Leaderboard
from saf_gen.leaderboard.report import write_evaluation


@pytest.fixture(scope="session")
def small_report(tmp_path_factory):
    """Folder and files of the report of a handmade evaluation. Do not change it."""
    folder = tmp_path_factory.mktemp("report")
    made = make_evaluation()
    write_evaluation(folder, Leaderboard.of(made), title="small", delivered=make_delivered())
    return folder, sorted(folder.iterdir())
