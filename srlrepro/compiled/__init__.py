"""What compiled code shares: the compiler, and arithmetic with the same bits on every processor."""
