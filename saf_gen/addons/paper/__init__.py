"""The paper by one command: the figures and the claims of Su et al. (CVPR 2024) on any dataset with its conditions."""
