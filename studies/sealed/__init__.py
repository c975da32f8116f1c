"""Test splits that nobody has seen, and the script that draws them by the commit that fixes a method."""
