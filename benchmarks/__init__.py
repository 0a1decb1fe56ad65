"""How fast the learner is; ``python -m benchmarks`` prints the table."""
