"""Sharing of datasets: they are described with Croissant, packed into shards with digests, and fetched."""

from saf_gen.stream.sharing.fetching import fetch_dataset
from saf_gen.stream.sharing.packing import pack_dataset

__all__ = ["fetch_dataset", "pack_dataset"]
