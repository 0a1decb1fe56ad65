"""Training runs: PPO with or without a supervisor, what they record, and how they go on after a kill."""

VISITED_FORMAT = "srlrepro-visited-1"  # of visited.npz, one of the products of a run
