"""Focal stacks on disk, the charge that a sensor collects from them, the true focus, and captures that can
be repeated."""
