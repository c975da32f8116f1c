"""What the author of a scene needs: a template to begin with, checks, a preview and the gallery."""
