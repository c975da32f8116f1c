"""Tools for authors of scenes: a template to start from, checks and a preview."""
