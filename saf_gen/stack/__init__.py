"""Focal stacks on disk, the charge a sensor collects from them, the true focus, and repeatable captures."""
