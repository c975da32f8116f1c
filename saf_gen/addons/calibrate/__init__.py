"""Comparison of real cameras with the sensor model: statistics of recordings, and sensors fitted to recordings."""
