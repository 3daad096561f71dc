"""Where a run keeps its cells: one file each, written at once, so that an interrupted run loses only what runs."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodyimage_kin._files import atomic_path
from bodyimage_kin.errors import OutputRefused
from bodyimage_kin.published.foreknowledge.cell import Cell, Settings
from bodyimage_kin.published.foreknowledge.conditions import Condition
from bodyimage_kin.recordings.schema import versions


@dataclass(frozen=True)
class Store:
    """A folder of cells. A file is named by the hash of all that decides it, so that runs of any settings may share it.

    Attributes:
        folder: Made when missing.
        settings: Of the run; how many seeds it has decides no cell.
        body: Hash of the embodiment.
    """

    folder: Path
    settings: Settings
    body: str

    def read(self, condition: Condition, seed: int) -> Cell | None:
        """The cell; None when it is not there.

        Raises:
            OutputRefused: A damaged file.
        """
        path = self._path(condition, seed)
        if not path.exists():
            return None
        try:
            with np.load(path, allow_pickle=False) as stored:
                values = dict(stored)
            refused = json.loads(str(values.pop("refused")))
            return Cell(**values, refused=refused)
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as problem:
            raise OutputRefused(f"'{path}' cannot be read ({problem}); delete it, and it is computed again") from None

    def write(self, condition: Condition, seed: int, cell: Cell) -> None:
        """Keeps a cell, atomically.

        Raises:
            OutputRefused: A place that cannot be written to.
        """
        path = self._path(condition, seed)
        values = {field.name: getattr(cell, field.name) for field in dataclasses.fields(cell)}
        values["refused"] = np.array(json.dumps(cell.refused))
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with atomic_path(path) as temporary, temporary.open("wb") as file:
                np.savez(file, **values)
        except OSError as problem:
            raise OutputRefused(f"cannot write '{path}': {problem.strerror}; name another folder") from None

    def _path(self, condition: Condition, seed: int) -> Path:
        decides = {
            "settings": dataclasses.asdict(dataclasses.replace(self.settings, seeds=1)),
            "body": self.body,
            "condition": dataclasses.asdict(condition),
            "seed": seed,
            "versions": versions(),
        }
        name = hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()
        return self.folder / f"{name[:24]}.npz"
