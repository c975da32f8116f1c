"""A camera to hold: it runs while somebody turns focus and lamps, as an object, a page or a device of a laboratory.

Nothing is rendered while it runs: one traced focal stack serves every position of the lens and every light.
"""
