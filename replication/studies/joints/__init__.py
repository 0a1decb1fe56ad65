"""Pendulums with 1 to 8 joints: where does a low-dimensional region start to pay? No training is needed."""
