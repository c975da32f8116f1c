"""Reads what users write: strict YAML and JSON, ranges of numbers, plug-ins by name."""
