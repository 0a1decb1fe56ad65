"""Training runs: PPO with or without a supervisor, what they record, and how they go on after a kill."""
