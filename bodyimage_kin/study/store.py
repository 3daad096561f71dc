"""Where a study is kept: one NetCDF file a cell, written atomically, so that an interrupted run loses only what runs.

::

    bodyimage_kin.json                                  what the store is for
    recordings/EMBODIMENT/RECORDING/seed3_training.nc   and _touch, _tour: recordings, one file each
    scenes/EMBODIMENT/RECORDING/block0.nc               what the recordings excite, and how far the probes are
    cells/EMBODIMENT/RECORDING/ESTIMATOR/block0.nc      scores
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from bodyimage_kin import _files
from bodyimage_kin._files import atomic_path
from bodyimage_kin.errors import InvalidConfig, OutputRefused
from bodyimage_kin.recordings import read_recording, write_recording
from bodyimage_kin.study.cells import Ground, Scene

KIND = "study"
_ROLES = ("training", "touch", "tour")


@dataclass(frozen=True)
class Store:
    """A folder of results.

    Attributes:
        folder: The folder.
    """

    folder: Path

    @classmethod
    def claim(cls, folder: Path, origin: Mapping[str, Any], begin: Path) -> Store:
        """The store of a study, made when missing.

        Args:
            folder: New, empty, or of the same study, or of one that this study adds to (:func:`before_it_grew`).
            origin: Config and hashes; all that decides what comes out.
            begin: Where the study's relative paths begin.

        Raises:
            OutputRefused: A folder of something else, or of a study with another origin; says what differs.
        """
        before = settings(folder)
        stored = {key: value for key, value in (before or origin).items() if key != "folder"}
        if different := list(differences(stored, before_it_grew(stored, origin))):
            shown = "; ".join(different[:5]) + (f"; and {len(different) - 5} more" if len(different) > 5 else "")
            raise OutputRefused(f"'{folder}' holds another study: {shown}; name another folder for this one")
        return cls(_files.claim(folder, KIND, {**origin, "folder": str(begin.absolute())}))

    def cell(self, ground: Ground, block: int, estimator: str) -> Path:
        """File of a cell."""
        return self._place("cells", ground) / estimator / f"block{block}.nc"

    def scene(self, ground: Ground, block: int) -> Path:
        """File of a ground's facts; it is written last, so it says that the recordings are there."""
        return self._place("scenes", ground) / f"block{block}.nc"

    def read_scene(self, ground: Ground, block: int) -> Scene:
        """What :meth:`write_scene` wrote, of the recordings those that cells need."""
        recordings = {
            role: [read_recording(self._recording(ground, seed, role)) for seed in ground.seeds]
            for role in ground.roles
        }
        return Scene(recordings, read(self.scene(ground, block)))

    def write_scene(self, ground: Ground, block: int, scene: Scene, origin: Mapping[str, str]) -> None:
        """Writes recordings, then facts."""
        for role in _ROLES:
            for seed, recording in zip(ground.seeds, scene.recordings[role], strict=True):
                path = self._recording(ground, seed, role)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_recording(recording, path)
        write(scene.facts.assign_attrs(origin), self.scene(ground, block))

    def _place(self, what: str, ground: Ground) -> Path:
        return self.folder / what / ground.embodiment / ground.recording

    def _recording(self, ground: Ground, seed: int, role: str) -> Path:
        return self._place("recordings", ground) / f"seed{seed}_{role}.nc"


def settings(folder: Path) -> dict[str, Any] | None:
    """What the study in a folder was asked for; None when there is none."""
    try:
        marker = json.loads((folder / "bodyimage_kin.json").read_text(encoding="utf-8"))
        return dict(marker["settings"]) if marker["kind"] == KIND else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def before_it_grew(stored: Mapping[str, Any], asked: Mapping[str, Any]) -> dict[str, Any]:
    """What is asked, without what may be added to a store: then nothing may differ.

    A cell's random streams are its own, and its seeds learn together. So embodiments, recordings and estimators may be
    added, and seeds after blocks that are complete: no bit of a cell that is there already depends on them.
    """
    config = dict(asked["config"])
    there = stored.get("config", {})
    found = dict(asked, config=config)
    for table, names in (
        *((config, name) for name in ("embodiments", "recordings", "estimators")),
        *((found, name) for name in ("urdf_sha256", "embodiment_sha256", "skin_shape")),
    ):
        known = (there if table is config else stored).get(names, {})
        table[names] = {name: value for name, value in table[names].items() if name in known}
    seeds, count = config["seeds"], len(there.get("seeds", []))
    if count % config["block"] == 0 and seeds[:count] == there.get("seeds"):
        config["seeds"] = seeds[:count]
    return found


def differences(stored: Any, asked: Any, name: str = "") -> Iterator[str]:
    """Every value that two nested tables do not share, in words."""
    if isinstance(stored, Mapping) and isinstance(asked, Mapping):
        for key in [*stored, *(key for key in asked if key not in stored)]:
            place = f"{name}.{key}" if name else str(key)
            if key not in stored or key not in asked:
                yield f"{place} is only {'in the store' if key in stored else 'asked'}"
            else:
                yield from differences(stored[key], asked[key], place)
    elif json.dumps(stored) != json.dumps(asked):
        yield f"{name} is {stored!r} in the store, {asked!r} asked"


def write(dataset: xr.Dataset, path: Path) -> None:
    """Writes a NetCDF file atomically.

    Raises:
        OutputRefused: A place that cannot be written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            dataset.to_netcdf(temporary, engine="h5netcdf")
    except OSError as problem:
        raise OutputRefused(f"cannot write '{path}': {problem}; name another folder") from problem


def read(path: Path) -> xr.Dataset:
    """Reads a file that :func:`write` wrote.

    Raises:
        InvalidConfig: A file that is missing or damaged.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as stored:
            return stored.load()
    except (OSError, ValueError, KeyError) as problem:
        raise InvalidConfig(f"'{path}' cannot be read ({problem}); delete it, and its cell is computed again") from None
