"""What curiosity methods reward along scripted episodes."""
