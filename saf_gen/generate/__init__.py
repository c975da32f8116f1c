"""From a recipe to a dataset: draw the sequences, render their focal stacks, record their streams."""
