"""From results to verdicts: measures, the claims of the paper, and statistics."""
