"""The embodiments of a study, from their tables."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import torch

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.study.blocks import Block
from bodyimage_kin.study.specs import Table

__all__ = ["body_of", "load_body"]


def body_of(table: Table, folder: Path, store: Path = Path()) -> Embodiment | None:
    """An embodiment; None: there is none.

    Args:
        table: ``{"embodiment": NAME or PATH}`` or ``{"given": HASH}``, perhaps with ``backend`` and ``mesh_folder``.
        folder: Where relative paths begin.
        store: Of the study, for embodiments that it was handed.
    """
    return _load(*_where(table, folder, store))


def load_body(block: Block) -> Embodiment | None:
    """The embodiment of a block, loaded once a process; makes the process one that computes with one thread.

    Raises:
        InvalidConfig: It is not the one that the study began with.
    """
    # Bits depend on how sums are divided among threads, and the processes of a pool divide the work already.
    torch.set_num_threads(1)
    place, backend, meshes = _where(block.body, Path(block.folder), Path(block.store))
    return _load_once(place, backend, meshes, block.sha256)


# Inner ---------------------------------------------------------------------------------------------------------------


def _where(table: Table, folder: Path, store: Path) -> tuple[str, str | None, Path | None]:
    """Name or path of an embodiment, empty where there is none; its backend and the folder of its meshes."""
    meshes = folder / table["mesh_folder"] if "mesh_folder" in table else None
    place = str(table.get("embodiment", ""))
    if "given" in table:
        place = str(store / "given" / table["given"] / "embodiment.toml")
    elif place.endswith(".toml"):
        place = str((folder / place).absolute())
    return place, table.get("backend"), meshes


def _load(place: str, backend: str | None, meshes: Path | None) -> Embodiment | None:
    return load_embodiment(place, backend, mesh_folder=meshes) if place else None


@lru_cache(maxsize=8)
def _load_once(place: str, backend: str | None, meshes: Path | None, sha256: str) -> Embodiment | None:
    body = _load(place, backend, meshes)
    if body is not None and body.sha256 != sha256:
        raise InvalidConfig(f"embodiment '{place}' has changed since the study began; begin a new one")
    return body
