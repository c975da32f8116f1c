"""The product held against its targets: how fast it is, and whether what it makes obeys the laws."""
