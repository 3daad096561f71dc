"""The recordings of a block, simulated or handed over: what is learned from, used on, and compared along."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.recordings import simulate_many
from bodyimage_kin.study import random_streams
from bodyimage_kin.study.blocks import Block
from bodyimage_kin.study.grid import ROLES, Simulation
from bodyimage_kin.study.specs import MOTION, Table, from_settings

__all__ = ["recordings_of", "simulation_of"]

_UNFELT = {"f": np.nan, "i": -1, "u": 0, "b": False}
"""What pads the shorter of several trials, by kind of number."""


def recordings_of(block: Block, body: Embodiment | None) -> dict[str, list[Any]]:
    """Role -> one a seed: a recording, or the hash of one that the study was handed.

    Raises:
        InvalidConfig: A motion, and no embodiment that could make it.
    """
    table, found = block.simulation, {}
    motions = {role: table[role] if isinstance(table.get(role), list) else [table.get(role)] for role in ROLES}
    count = len(ROLES) + len(motions["training"]) - 1
    streams = [random_streams.of_recordings(block, seed, count) for seed in block.seeds]
    for index, role in enumerate(ROLES):
        one = table.get(role)
        if one in (None, "none") or (
            role != "training" and (body is None or body.skin is None) and "recording" not in one
        ):
            continue
        if "recording" in one:
            given = one["recording"]
            found[role] = [given[n] if isinstance(given, list) else given for n in block.places]
            continue
        if body is None:
            raise InvalidConfig(f"{role}: a motion is simulated with an embodiment; give a recording, or a body")
        # Further motions of the training have streams after those of the first three recordings.
        numbers = [index, *range(len(ROLES), count)] if role == "training" else [index]
        trials = [
            _simulated(block, body, motion, [one[number] for one in streams])
            for motion, number in zip(motions[role], numbers, strict=True)
        ]
        found[role] = [_one_recording(ones) for ones in zip(*trials, strict=True)]
    return found


@lru_cache(maxsize=2)
def simulation_of(block: Block) -> Simulation:
    """How the recordings came about; what was given stands as the hash of it."""
    folder, parts = Path(block.folder), dict(block.simulation)
    for role in ROLES:
        one = parts.get(role)
        if isinstance(one, list):
            parts[role] = tuple(MOTION.build(motion, folder) for motion in one)
        elif isinstance(one, Mapping) and "recording" not in one:
            parts[role] = MOTION.build(one, folder)
    return from_settings(Simulation, parts, folder)


# Inner ---------------------------------------------------------------------------------------------------------------


def _simulated(block: Block, body: Embodiment, motion: Table, seeds: list[int]) -> list[xr.Dataset]:
    how = simulation_of(block)
    asked = body, MOTION.build(motion, Path(block.folder), body), tuple(seeds), how.dynamics, how.noise, how.touch_seen
    try:
        return _simulated_once(*asked)
    except TypeError as problem:
        if "unhashable" not in str(problem):
            raise
        return _simulated_once.__wrapped__(*asked)


# Entries that share a stream share recordings, such as the touches of several trainings.
@lru_cache(maxsize=8)
def _simulated_once(
    body: Embodiment, motion: Any, seeds: tuple[int, ...], dynamics: Any, noise: Any, touch_seen: bool
) -> list[xr.Dataset]:
    return simulate_many(body, motion, list(seeds), dynamics=dynamics, noise=noise, threads=1, touch_seen=touch_seen)


def _one_recording(trials: Sequence[xr.Dataset]) -> xr.Dataset:
    """Several recordings as trials of one, the shorter ones padded."""
    if len(trials) == 1:
        return trials[0]
    first = 0
    numbered = []
    for one in trials:
        numbered.append(one.assign_coords(trial=np.arange(first, first + one.sizes["trial"])))
        first += one.sizes["trial"]
    fill = {name: _UNFELT.get(one.dtype.kind, "") for name, one in trials[0].data_vars.items()}
    return xr.concat(
        numbered, "trial", data_vars="minimal", coords="minimal", compat="override", join="outer", fill_value=fill,
        combine_attrs="override",
    )  # fmt: skip
