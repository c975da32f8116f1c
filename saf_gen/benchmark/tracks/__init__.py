"""The evaluator: it runs methods on recordings or on a running camera, and judges their answers."""
