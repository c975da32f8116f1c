"""Methods of others, each in a process of its own that sees counts and lens positions, and nothing else.

The evaluator (:mod:`host`) and a guest (:mod:`process`) exchange messages over the line of a child
(:mod:`saf_gen.core.child`).
"""
