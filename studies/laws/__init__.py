"""Laws that the output of saf_gen must obey: it is run as a user runs it, and compared with theory and other code.

A law is a function in the module of its subject, with an entry in the module's ``LAWS``. ``python -m studies.laws``
checks the laws and writes the page studies/results/validation.md; tests/studies/test_laws.py checks each at its small
size.
"""
