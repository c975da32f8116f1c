"""The report of an evaluation: one page for a browser, its figures as files, and the folder of all of it."""

from saf_gen.report.folder import Written, write_evaluation, write_report
from saf_gen.report.page import page
from saf_gen.report.pictures import Picture, draw

__all__ = ["Picture", "Written", "draw", "page", "write_evaluation", "write_report"]
