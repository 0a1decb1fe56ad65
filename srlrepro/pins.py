"""The number of the arithmetic that results rest on."""

ARITHMETIC = 1
