"""Real focal stacks as a judged track: the sources, the rule of truth, the boxes, and the recordings made of them."""
