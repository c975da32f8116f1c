"""Sharing of datasets: description with Croissant, and fetching of what others publish."""

from saf_gen.stream.sharing.fetching import fetch_dataset

__all__ = ["fetch_dataset"]
