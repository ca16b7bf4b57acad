"""Times several functions in turns, so that other load on the machine slows all of them equally."""

import time
from collections.abc import Callable

import numpy as np


def side_by_side(functions: dict[str, Callable[[], object]], rounds: int = 15) -> dict[str, np.ndarray]:
    """Seconds `(rounds,)` that each function took; one unmeasured call of each comes first.

    Divide two of them round by round and take the median of the ratios.
    """
    for function in functions.values():
        function()
    seconds = {name: np.empty(rounds) for name in functions}
    for k in range(rounds):
        for name, function in functions.items():
            start = time.perf_counter()
            function()
            seconds[name][k] = time.perf_counter() - start
    return seconds


def ratio(seconds: dict[str, np.ndarray], name: str, base: str) -> float:
    """Median over rounds of what `name` took as a multiple of `base`."""
    return float(np.median(seconds[name] / seconds[base]))
