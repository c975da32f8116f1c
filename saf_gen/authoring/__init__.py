"""Tools for authors of scenes: a template to start from, checks, a preview and the gallery."""
