"""A scene on disk: its card, its geometry as a script or as XML, its motion and its digest."""
