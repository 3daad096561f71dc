"""The blocks that a study is worked off in, in plain data.

Nothing here builds what a table names, so that whoever only looks at a store imports nothing of it, and nothing heavy.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Block", "blocks"]


@dataclass(frozen=True, eq=False)
class Block:
    """A block of seeds of one recording of one embodiment: all that a worker is told of it, in plain data.

    Attributes:
        store: Folder of the store, absolute.
        folder: Where the study's relative paths begin, and where its own modules may lie.
        embodiment: Its name in the study.
        recording: Likewise.
        number: Of the block.
        seeds: Its seeds.
        first: Place of the first of them among the study's.
        body: Table of the embodiment.
        sha256: Hash of the embodiment that the study began with; empty: there is no embodiment.
        simulation: Table of the recording.
        settings: Of the study, but for its axes and seeds.
    """

    store: str
    folder: str
    embodiment: str
    recording: str
    number: int
    seeds: tuple[int, ...]
    first: int
    body: dict[str, Any]
    sha256: str
    simulation: dict[str, Any]
    settings: dict[str, Any]

    @property
    def place(self) -> str:
        """Folder of its files within each part of the store."""
        return f"{self.embodiment}/{self.recording}"

    def __hash__(self) -> int:
        return hash((self.store, self.place, self.number))

    def __eq__(self, other: object) -> bool:
        if self is other or not isinstance(other, Block):
            return self is other
        return (self.store, self.identity()) == (other.store, other.identity())

    @property
    def places(self) -> range:
        """Of its seeds among the study's."""
        return range(self.first, self.first + len(self.seeds))

    def is_on(self, row: dict[str, Any]) -> bool:
        """Whether a row is computed here."""
        on = row.get("on", []) if "estimator" in row else []
        return not on or self.recording in on or self.place in on

    def config(self, row: dict[str, Any] | None = None) -> str:
        """Hash of all that decides what comes of a row, or without one of the recordings; the same for every block."""
        decides = [self.sha256, self.body.get("backend"), self.simulation, self.settings, row]
        return hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()

    def identity(self, estimator: str = "", config: str = "") -> dict[str, Any]:
        """What a part of this block says it is: a cell's scores, or without an estimator the recordings.

        Args:
            estimator: Name of the row.
            config: Of the row (:meth:`config`); empty: that of the recordings.
        """
        return {
            "embodiment": self.embodiment,
            "recording": self.recording,
            "estimator": estimator,
            "block": self.number,
            "seeds": list(self.seeds),
            "config": config or self.config(),
        }


def blocks(origin: Mapping[str, Any], store: Path) -> list[Block]:
    """The blocks of a study, in the order of its axes.

    Args:
        origin: What the study was asked for, as its store keeps it: ``config``, ``embodiment_sha256``, ``folder``.
        store: Folder of the store.
    """
    config = origin["config"]
    seeds, size = tuple(config["seeds"]), int(config["block"])
    apart = ("embodiments", "recordings", "estimators", "seeds", "block", "time_limit", "labels")
    settings = {name: value for name, value in config.items() if name not in apart}
    return [
        Block(
            store=str(store),
            folder=str(origin.get("folder", "")),
            embodiment=embodiment,
            recording=recording,
            number=number,
            seeds=seeds[first : first + size],
            first=first,
            body=body,
            sha256=origin["embodiment_sha256"][embodiment],
            simulation=simulation,
            settings=settings,
        )
        for embodiment, body in config["embodiments"].items()
        for recording, simulation in config["recordings"].items()
        for number, first in enumerate(range(0, len(seeds), size))
    ]
