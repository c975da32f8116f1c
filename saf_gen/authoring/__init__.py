"""Tools for the author of a scene: a template to start from, checks, a preview and the gallery."""
