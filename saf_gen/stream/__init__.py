"""Stream files and dataset folders: the interface between generating data and benchmarking methods."""
