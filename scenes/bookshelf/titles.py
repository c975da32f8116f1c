"""Words for the spines: invented authors, titles and publishers."""

from __future__ import annotations

import numpy as np

NAMES = ("ALDER", "BRANDT", "CORVIN", "DELANEY", "ESKELUND", "FERRIS", "GRAUER", "HOLLIS", "IBSTOCK",
         "JARVEY", "KESTREL", "LINDQVIST", "MARLOWE", "NORTHAM", "OKAFOR", "PETRAKIS", "QUILLER", "ROSSI",
         "SANDOVAL", "TAKEDA", "UNWIN", "VESPER", "WHITLOCK", "YARROW", "ZELLER")  # fmt: skip
ADJECTIVES = ("SILENT", "LOST", "NORTHERN", "PAPER", "HIDDEN", "GLASS", "LONG", "IRON", "WINTER", "SEVENTH",
              "DISTANT", "BROKEN", "SECOND", "AMBER", "QUIET", "SALT")  # fmt: skip
THINGS = ("HARBOUR", "ORCHARD", "CARTOGRAPHER", "SUMMER", "RIVER", "LETTERS", "MACHINE", "GARDEN", "VOYAGE",
          "MOUNTAIN", "CLOCK", "ISLAND", "WITNESS", "LIBRARY", "TIDE", "BRIDGE")  # fmt: skip
SUBJECTS = ("OPTICS", "TREES", "NAVIGATION", "BEES", "COINAGE", "BRIDGES", "WEATHER", "MUSIC", "ROADS",
            "GLASS", "MOSSES", "PRINTING", "TEA", "LIGHTHOUSES", "GEOMETRY", "SHIPS")  # fmt: skip
KINDS = ("A HISTORY OF", "NOTES ON", "THE BOOK OF", "ELEMENTS OF", "A GUIDE TO")
SERIES = ("COLLECTED WORKS", "WORLD HISTORY", "ENCYCLOPEDIA", "NATURAL SCIENCE", "COMPLETE PLAYS")
JOURNALS = ("ANNALS OF OPTICS", "QUARTERLY REVIEW", "JOURNAL OF LETTERS", "GEOGRAPHIC MONTHLY")


def title(random: np.random.Generator) -> str:
    """Of a novel or of a handbook."""
    if random.random() < 0.4:
        return f"{random.choice(KINDS)} {random.choice(SUBJECTS)}"
    return f"THE {random.choice(ADJECTIVES)} {random.choice(THINGS)}"


def author(random: np.random.Generator) -> str:
    """A surname, with initials where there is room."""
    initials = "".join(f"{letter}. " for letter in random.choice(list("ABCDEFGHJKLMPRSTW"), 2))
    return f"{initials}{random.choice(NAMES)}" if random.random() < 0.4 else str(random.choice(NAMES))
