"""Lens files: the surfaces of a real lens, rays through them, and the polynomials that stand for them in a renderer.

A file is read into a :class:`~saf_gen.optics.lens_file.prescription.Prescription` (``reading``), rays are traced
through its surfaces (``trace``), its pupils are found (``pupils``), and polynomials are fitted to the rays (``fit``).
"""
