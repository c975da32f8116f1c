"""The referee: what methods are run on, what they answered, and how that is judged. Methods never see it."""
