"""Recipes of test splits whose seed nobody knew until their secret was published, and the script that opens them."""
