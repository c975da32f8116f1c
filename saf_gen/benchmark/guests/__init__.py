"""Methods of others, each in a process of its own that sees counts and lens positions, and nothing else.

The evaluator (:mod:`host`) and a guest (:mod:`process`) talk over the pipes and the shared memory of :mod:`wire`.
"""
