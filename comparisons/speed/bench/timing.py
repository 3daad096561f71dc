"""The clock: in turns, so that a busy moment of the machine strikes all alike; medians and quartiles."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

_LEAST = 1e-2
"""Shorter work is repeated until a measurement takes about as long [s]: what others left in caches counts little."""
_FEWEST = 3
"""Rounds that are measured whatever they cost, for a median."""


def turns(
    work: Mapping[str, Callable[[], Any]],
    rounds: int,
    clock: Callable[[], float] = time.process_time,
    budget: float = math.inf,
) -> dict[str, list[float]]:
    """Seconds of every piece of work, in turns.

    Args:
        work: Name -> what is called; once unmeasured, so that nothing is compiled or built in a measurement.
        rounds: Turns.
        clock: Of the seconds.
        budget: Once so many seconds are spent, no further turn begins, after three.
    """
    repeats = {}
    start = clock()
    for name, call in work.items():
        call()
        begin = clock()
        call()
        repeats[name] = max(1, int(_LEAST / max(clock() - begin, 1e-9)))
    seconds: dict[str, list[float]] = {name: [] for name in work}
    for turn in range(rounds):
        if turn >= _FEWEST and clock() - start > budget:
            break
        for name, call in work.items():
            begin = clock()
            for _ in range(repeats[name]):
                call()
            seconds[name].append((clock() - begin) / repeats[name])
    return seconds


def quartiles(values: Iterable[float]) -> list[float]:
    """Lower quartile, median, upper quartile."""
    return [float(value) for value in np.quantile(list(values), [0.25, 0.5, 0.75])]
