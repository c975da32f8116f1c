"""Readers of what users write: strict YAML and JSON, ranges of numbers, and plug-ins by name."""
