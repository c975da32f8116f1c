"""Scenes on disk: their cards, geometry, motion, shared library modules, and digests."""
