"""Lens files: the surfaces of a real lens, rays through them, and polynomials fitted to the rays for a renderer."""
