"""The benchmark: problems with known solutions, and the packages that solve them."""
