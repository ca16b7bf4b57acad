"""A grid of runs: tasks × methods × seeds."""
