"""Readers of configuration: strict YAML and JSON, ranges of numbers, and plug-ins found by name."""
