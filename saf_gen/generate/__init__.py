"""Generation of datasets from recipes: draws sequences, renders their focal stacks, and records their streams."""
