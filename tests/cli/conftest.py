import saf_gen.leaderboard.report.evaluation_folder  # noqa: F401  so that reports are made without figures
