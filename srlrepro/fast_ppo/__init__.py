"""stable-baselines3's PPO with compiled rollouts and updates."""
