"""Acceptance tests of saf_gen: how fast it is, and whether its output obeys the laws of physics."""
