"""The explorer: one page in which a reader moves a state, and sees what the supervisor thinks of it."""
