"""Studies beside the grid of the paper."""
