"""Studies of the ranking: coverage of its intervals, agreement between conditions, and the tables of the results."""
