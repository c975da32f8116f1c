"""Sharing of datasets: description with Croissant, packing into tar shards with digests, and fetching."""

from saf_gen.stream.sharing.fetching import fetch_dataset
from saf_gen.stream.sharing.packing import pack_dataset

__all__ = ["fetch_dataset", "pack_dataset"]
