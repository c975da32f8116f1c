"""Plug-ins: light schedules, lens motions, focus measures and searches, with a folder per kind and a file per plug-in.

Each folder has a function that finds its plug-ins by name, such as :func:`saf_gen.get_measure`. Other packages add
plug-ins with the entry points ``saf_gen.lights``, ``saf_gen.motions``, ``saf_gen.measures`` and ``saf_gen.searches``.
"""
