"""Results on disk: written whole, read with checks, and marked with what made them."""
