"""Speed, memory, file size and error of the product: ratios within one run, or rates with their workload."""
