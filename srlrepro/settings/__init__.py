"""Every number of a replication: what the paper states, what we chose, and how they are varied."""
