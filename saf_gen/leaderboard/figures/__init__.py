"""Figures of an evaluation: focus curves, errors, success by condition, and paths of searches and of the lens."""
