"""What we run on saf_gen ourselves: laws, speed, rankings, learned methods and results; no part of the package."""
