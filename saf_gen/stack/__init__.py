"""Focal stacks on disk, the charge that a sensor collects from them, the true focus, and repeatable captures."""
