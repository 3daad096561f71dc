"""What a study consists of, in plain data: entries of its three axes as specs, and the blocks they are worked off in.

Nothing here builds what a table names, so that whoever only looks at a store imports nothing of it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bodyimage_kin._checks import choice, flag, text, whole
from bodyimage_kin.body_image.integration import METHODS, RESETS
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.recordings import Drag, Noise
from bodyimage_kin.study.specs import Table

__all__ = ["ROLES", "Block", "Row", "Simulation", "blocks", "stream"]

ROLES = ("training", "use", "tour")
"""Recordings of an entry: learned from, used on, compared along."""


@dataclass(frozen=True)
class Simulation:
    """Recordings that belong together: what is learned from, and what that is used on.

    A bare motion or dataset given to a study stands for ``Simulation(training=...)``.

    Attributes:
        training: A motion; several, recorded as trials of one recording; or what is there already: a recording
            (``xarray.Dataset``), or a list of them, one a seed, taken as they are.
        use: Touches: their motion's metric counts, and maps are learned from them. Likewise a motion, a recording or a
            list of them. None: what the study says; without that 80 s of random touch beside a simulated training, and
            nothing beside a recording.
        tour: Where displacements are compared. None: a tour of the face beside a simulated training, at its speed and
            sampling. ``use`` and ``tour`` are left out on a body without a skin.
        dynamics: As of :func:`bodyimage_kin.simulate`, for all motions.
        noise: Likewise.
        stream: Name of the random streams of what is simulated; entries of one name are paired: the same motion moves
            the same way in all of them. Empty: the entry's own name.
    """

    training: Any
    use: Any = None
    tour: Any = None
    dynamics: bool | Drag = True
    noise: Noise | None = None
    stream: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.dynamics, Drag):
            object.__setattr__(self, "dynamics", flag("dynamics", self.dynamics))
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise InvalidConfig(f"noise is {type(self.noise).__name__}; give bk.Noise(...) or None")
        if self.stream:
            text("stream", self.stream)


@dataclass(frozen=True)
class Row:
    """One row of a study's results: an estimator, and how what it learns is used.

    A bare estimator given to a study stands for ``Row(estimator)``.

    Attributes:
        estimator: Object, class, name or table; None: direct sight, which is handed the true image of the hand and has
            no Jacobian.
        told: Setting -> name of a fact of the recording: what the estimator is told beside the experience, such as
            ``{"scale": "depth_ratio"}``.
        method: Rule of :func:`bodyimage_kin.integrate`.
        substeps: Likewise.
        reset: Likewise, for touches; the posture map is learned from the training, ``"none"`` begins at the reference.
        on: Names of the recordings, or ``embodiment/recording``, that the row is computed on; none: all.
        maps: Settings of :meth:`bodyimage_kin.BodyImage.learn` that differ from the study's.
        first_maps: As of the study, where it differs.
        stream: Name of the random stream of the fit; rows of one name and one estimator learn the same. Empty: its own.
    """

    estimator: Any = None
    told: Mapping[str, str] = field(default_factory=dict)
    method: str = "euler"
    substeps: int = 1
    reset: str = "reference"
    on: tuple[str, ...] = ()
    maps: Mapping[str, Any] = field(default_factory=dict)
    first_maps: int | Mapping[Any, int] | None = None
    stream: str = ""

    def __post_init__(self) -> None:
        choice("method", self.method, METHODS)
        choice("reset", self.reset, RESETS)
        whole("substeps", self.substeps, least=1)
        on: Any = self.on
        if isinstance(on, str) or not all(isinstance(name, str) for name in on):
            raise InvalidConfig(f"on={on!r}: give names of recordings in a list")
        object.__setattr__(self, "on", tuple(on))
        for name, value in (("told", self.told), ("maps", self.maps)):
            if not isinstance(value, Mapping):
                raise InvalidConfig(f"{name}={value!r}: give a table of settings")
        if self.told and self.estimator is None:
            raise InvalidConfig("told: direct sight has no setting that could be told; name an estimator")


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
    body: Table
    sha256: str
    simulation: Table
    settings: Table

    @property
    def place(self) -> str:
        """Folder of its files within each part of the store."""
        return f"{self.embodiment}/{self.recording}"

    def __hash__(self) -> int:
        return hash((self.store, self.place, self.number))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Block) and (self.store, self.identity()) == (other.store, other.identity())

    @property
    def places(self) -> range:
        """Of its seeds among the study's."""
        return range(self.first, self.first + len(self.seeds))

    def is_on(self, row: Table) -> bool:
        """Whether a row is computed here."""
        on = row.get("on", []) if "estimator" in row else []
        return not on or self.recording in on or self.place in on

    def identity(self, estimator: str = "", row: Table | None = None) -> Table:
        """What a file of this block says it is: a cell's scores, or without an estimator the recordings' facts."""
        decides = [self.sha256, self.body.get("backend"), self.simulation, self.settings, row]
        return {
            "embodiment": self.embodiment,
            "recording": self.recording,
            "estimator": estimator,
            "block": self.number,
            "seeds": list(self.seeds),
            "config": hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest(),
        }

    def seeds_of(self, what: str, seed: int, count: int) -> list[int]:
        """Seeds of what is drawn at random for one of the block's seeds; the first ones are those of fewer.

        Args:
            what: ``"recordings"`` (training, use, tour, further training), ``"first maps"`` (posture map, then each of
                the first maps), or the name of a row's stream (its fit).
            seed: Of the block.
            count: How many.
        """
        base = f"{self.embodiment}/{self.simulation.get('stream') or self.recording}/{seed}"
        return stream(self.settings["seed"], base if what == "recordings" else f"{base}/{what}", count)


def stream(entropy: int, name: str, count: int = 1) -> list[int]:
    """Seeds of what bears a name: a ``SeedSequence``, spawned by the name.

    Args:
        entropy: Seed of all.
        name: Such as ``embodiment/recording/seed``.
        count: How many.

    Returns:
        Numbers below 2^32, which every library takes.
    """
    key = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    return [int(value) for value in np.random.SeedSequence(entropy, spawn_key=key.tolist()).generate_state(count)]


def blocks(origin: Mapping[str, Any], store: Path) -> list[Block]:
    """The blocks of a study, in the order of its axes.

    Args:
        origin: What the study was asked for, as its store keeps it: ``config``, ``embodiment_sha256``, ``folder``.
        store: Folder of the store.
    """
    config = origin["config"]
    seeds, size = tuple(config["seeds"]), int(config["block"])
    apart = ("embodiments", "recordings", "estimators", "seeds", "block", "time_limit")
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
