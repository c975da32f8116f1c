"""The report of an evaluation: an HTML page, its figures as files, and the folder that holds all files."""

from saf_gen.leaderboard.report.choose_figures import ReportFigure, plot_report_figures
from saf_gen.leaderboard.report.evaluation_folder import WrittenEvaluation, write_evaluation_report, write_report
from saf_gen.leaderboard.report.page import build_report_page

__all__ = [
    "ReportFigure",
    "WrittenEvaluation",
    "build_report_page",
    "plot_report_figures",
    "write_evaluation_report",
    "write_report",
]
