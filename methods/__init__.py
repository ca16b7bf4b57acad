"""Intrinsic rewards, curricula and relabellings, one file each, and the agents that learn with them."""
