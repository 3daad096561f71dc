"""Random streams: the seed of everything that a study draws at random, by the name of what it is drawn for.

Each cell has streams of its own, so nothing depends on who works, on how many do, or in what order, and what is added
to a study changes nothing of what was there. What is then drawn from a seed is up to who is given it: a simulation, an
estimator, a map.
"""

from __future__ import annotations

import hashlib

import numpy as np

from bodyimage_kin.study.blocks import Block

__all__ = ["of_a_fit", "of_maps", "of_recordings", "stream"]


def stream(entropy: int, name: str, count: int = 1) -> list[int]:
    """Seeds of what bears a name: a ``SeedSequence``, spawned by the name.

    Args:
        entropy: Seed of all.
        name: Such as ``embodiment/recording/seed``.
        count: How many; the first ones are those of fewer.

    Returns:
        Numbers below 2^32, which every library takes.
    """
    key = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    return [int(value) for value in np.random.SeedSequence(entropy, spawn_key=key.tolist()).generate_state(count)]


def of_recordings(block: Block, seed: int, count: int) -> list[int]:
    """Seeds of what is recorded for one of a block's seeds: training, use, tour, then further training."""
    return stream(block.settings["seed"], _place(block, seed), count)


def of_maps(block: Block, seed: int, count: int) -> list[int]:
    """Seeds of the posture map, then of each of the first maps; the same for every row."""
    return stream(block.settings["seed"], f"{_place(block, seed)}/first maps", count)


def of_a_fit(block: Block, seed: int, row: str) -> int:
    """Seed of what a row's estimator draws.

    Args:
        block: Of the cell.
        seed: One of its seeds.
        row: Name of the row's stream: its own name, unless it shares one.
    """
    return stream(block.settings["seed"], f"{_place(block, seed)}/{row}")[0]


def _place(block: Block, seed: int) -> str:
    """Entries that share a stream are paired: the same motion moves the same way in all of them."""
    return f"{block.embodiment}/{block.simulation.get('stream') or block.recording}/{seed}"
