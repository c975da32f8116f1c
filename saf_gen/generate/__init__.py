"""From a recipe to a dataset: draws the sequences, renders their focal stacks, and records their streams."""
