"""Scenes on disk: their cards, geometry, motion and digests."""
