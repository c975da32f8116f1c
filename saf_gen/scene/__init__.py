"""A scene on disk: its card, its geometry, its motion, the library it draws with, and its digest."""
