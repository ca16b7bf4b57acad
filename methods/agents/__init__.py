"""The agents: goal-conditioned SAC, and the hybrid policy mechanism around it."""
