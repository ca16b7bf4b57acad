"""Agents and intrinsic rewards."""
