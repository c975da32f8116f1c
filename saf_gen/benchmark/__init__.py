"""The benchmark: it runs autofocus methods on recordings or on a running camera, and records their results."""
