"""What curiosity methods reward along scripted episodes."""

from typing import Literal

Among = Literal["random", "replay"]
"""What a transition is scored among: random play, the same for all runs, or the run's own replay."""
