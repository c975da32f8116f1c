"""Reading what users write: strict YAML, open numbers, and plug-ins by name."""
