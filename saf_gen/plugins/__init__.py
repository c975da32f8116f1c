"""Plug-ins, one file each: light schedules, lens motions, focus measures and searches, a folder per kind.

A folder's own functions find its plug-ins by name, such as :func:`saf_gen.get_measure`. Packages offer more under the
entry points ``saf_gen.lights``, ``saf_gen.motions``, ``saf_gen.measures`` and ``saf_gen.searches``.
"""
