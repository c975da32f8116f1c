"""The stream file and the dataset folder: the contract between generating and benchmarking."""
