"""Published tables of artificial skins: the iCub's and NAO's, with whatever is odd in them told in notes.

Tables are read as they stand: what is a taxel, what a heat pad and what neither is said row by row, and
:meth:`TaxelTable.skin` makes a skin of the taxels alone. Recordings speak of taxels by the numbers of the table;
:meth:`bodyimage_kin.Skin.taxels_of` leads from these to those of the skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin._shown import Shown
from bodyimage_kin.body._rigid import rigid
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import InvalidConfig

__all__ = ["TaxelTable", "read_icub_taxels", "read_nao_taxels"]

_A_UNIT = 12
"""Numbers of a triangle: ten taxels and two pads."""
_NAO_PADS = (6, 10)


@dataclass(frozen=True, eq=False)
class TaxelTable(Shown):
    """The rows of a table of taxels.

    Attributes:
        name: What the table calls the part.
        ids: (rows,) number of each row in its maker's files.
        positions: (rows, 3) in the part [m].
        normals: (rows, 3) outward, of any length; None: the table has none.
        taxel: (rows,) whether a row is a taxel with a place.
        pad: (rows,) whether it is a heat pad.
        units: (rows,) the mounted unit that it belongs to; -1: none.
        notes: What is odd in the table.
    """

    name: str
    ids: Int[np.ndarray, "rows"]
    positions: Float[np.ndarray, "rows 3"]
    normals: Float[np.ndarray, "rows 3"] | None
    taxel: Bool[np.ndarray, "rows"]
    pad: Bool[np.ndarray, "rows"]
    units: Int[np.ndarray, "rows"]
    notes: tuple[str, ...]

    @property
    def counts(self) -> dict[str, int]:
        """How many rows are ``taxels``, ``pads``, and ``dummies``: neither."""
        return {
            "taxels": int(self.taxel.sum()),
            "pads": int(self.pad.sum()),
            "dummies": int((~self.taxel & ~self.pad).sum()),
        }

    def skin(self, link: str, link_T_part: ArrayLike | None = None, **settings: Any) -> Skin:
        """The taxels as a skin.

        Args:
            link: The link that bears the part.
            link_T_part: (4, 4) where the part is mounted in it; None: it is the link.
            settings: Others of :meth:`bodyimage_kin.Skin.points`.

        Raises:
            InvalidConfig: As :meth:`bodyimage_kin.Skin.points`; no taxel has a place.
        """
        pose = np.eye(4) if link_T_part is None else rigid("link_T_part", link_T_part)
        places = self.positions[self.taxel] @ pose[:3, :3].T + pose[:3, 3]
        normals = None if self.normals is None else self.normals[self.taxel] @ pose[:3, :3].T
        given = {"ids": self.ids[self.taxel], "units": self.units[self.taxel], "notes": self.notes} | settings
        if not len(places):
            raise InvalidConfig(f"the table of '{self.name}' has no taxel with a place; give another one")
        return Skin.points(places, normals, link=link, **given)


def read_icub_taxels(path: str | Path) -> TaxelTable:
    """A table of ``app/skinGui`` of the iCub: ``taxel2Repr`` decides what is a taxel.

    Args:
        path: A text file of ``name``, ``taxel2Repr ( ... )`` and, after ``[calibration]``, a row of position and normal
            for each taxel, in the link [m].

    Raises:
        InvalidConfig: No such file, or none of this form; names the line.
    """
    path = Path(path)
    lines = _lines(path)
    start = next((row for row, line in enumerate(lines) if line.strip().startswith("[calibration]")), None)
    if start is None:
        raise InvalidConfig(
            f"'{path.name}' has no line [calibration], after which taxels stand; give a table of the iCub"
        )
    head = " ".join(lines[:start])
    fields = {words[0]: words[1] for line in lines[:start] if len(words := line.split()) == 2}
    inside = head.partition("taxel2Repr")[2].partition("(")[2].partition(")")[0].split()
    try:
        kinds = np.array([int(word) for word in inside], dtype=np.int64)
    except ValueError:
        raise InvalidConfig(f"'{path.name}': taxel2Repr holds what is no whole number") from None
    rows = _numbers(path, lines, 6, start + 1)
    notes = []
    if len(kinds) != len(rows):
        more = "entries without a row" if len(kinds) > len(rows) else "rows without an entry, which are no taxels"
        notes.append(f"taxel2Repr has {len(kinds)} entries for {len(rows)} rows: {abs(len(kinds) - len(rows))} {more}")
    kinds = np.concatenate([kinds, np.full(max(0, len(rows) - len(kinds)), -1)])[: len(rows)]
    placed = (rows[:, :3] != 0.0).any(axis=1)
    meant, pad = kinds >= 0, kinds == -2
    for odd, said in (
        (meant & ~placed, "rows are marked as taxels and have no place: left out"),
        ((kinds == -1) & placed, "rows have a place and are marked as no taxels: left out"),
    ):
        if odd.any():
            notes.append(f"{int(odd.sum())} {said}")
    normals = rows[:, 3:]
    if not normals.any():
        notes.append("it has no normals: they are computed from neighbours")
    return TaxelTable(
        name=fields.get("name", path.stem),
        ids=np.arange(len(rows)),
        positions=rows[:, :3],
        normals=normals if normals.any() else None,
        taxel=meant & placed,
        pad=pad,
        units=np.where(kinds >= 0, kinds, -1),
        notes=tuple(notes),
    )


def read_nao_taxels(path: str | Path, patches: Sequence[Sequence[int]]) -> TaxelTable:
    """A table ``Transformations/PART.txt`` of NAO's skin.

    Its rows are places [m]: of the part, of its patches, of each mounted triangle in its patch, and of ten taxels in
    each triangle, in the order of their numbers. A taxel's number is ``12 * triangle + number``; 6 and 10 of a triangle
    are heat pads.

    Args:
        path: The table.
        patches: The triangles mounted on each patch, in the order of the file.

    Raises:
        InvalidConfig: No such file, or other rows than so many triangles have.
    """
    path = Path(path)
    rows = _numbers(path, _lines(path), 3)
    triangles = [[_checks.whole("patches", one, least=0) for one in patch] for patch in patches]
    mounted = [triangle for patch in triangles for triangle in patch]
    if len(set(mounted)) < len(mounted):
        raise InvalidConfig(f"patches={patches!r}: name each triangle once")
    taxels = _A_UNIT - len(_NAO_PADS)
    wanted = 1 + len(triangles) + (1 + taxels) * len(mounted)
    if len(rows) != wanted:
        raise InvalidConfig(
            f"'{path.name}' has {len(rows)} rows; {len(mounted)} triangles on {len(triangles)} patches have {wanted}"
        )
    of_patch = np.repeat(np.arange(len(triangles)), [len(patch) for patch in triangles])
    base = 1 + len(triangles)
    at_triangle = rows[base : base + len(mounted)] + rows[1 + of_patch]
    within = [number for number in range(_A_UNIT) if number not in _NAO_PADS]
    count = max(32, max(mounted) + 1) if mounted else 32
    places = np.zeros((count, _A_UNIT, 3))
    taxel, pad = np.zeros((count, _A_UNIT), dtype=bool), np.zeros((count, _A_UNIT), dtype=bool)
    # Taxels stand in the order of their numbers over all patches.
    for place, triangle in enumerate(sorted(mounted)):
        here = rows[base + len(mounted) + taxels * place :][:taxels]
        places[triangle, within] = here + at_triangle[mounted.index(triangle)]
        places[triangle, _NAO_PADS] = at_triangle[mounted.index(triangle)]
        taxel[triangle, within], pad[triangle, _NAO_PADS] = True, True
    places[sorted(mounted)] += rows[0]
    return TaxelTable(
        name=path.stem,
        ids=np.arange(count * _A_UNIT),
        positions=places.reshape(-1, 3),
        normals=None,
        taxel=taxel.ravel(),
        pad=pad.ravel(),
        units=np.repeat(np.arange(count), _A_UNIT),
        notes=(),
    )


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as problem:
        raise InvalidConfig(f"cannot read the taxels of '{path}': {problem.strerror}") from None


def _numbers(path: Path, lines: Sequence[str], width: int, start: int = 0) -> Float[np.ndarray, "rows width"]:
    rows = []
    for number, line in enumerate(lines[start:], start + 1):
        words = line.split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != width or not np.isfinite(row).all():
            raise InvalidConfig(f"'{path.name}' line {number}: '{line.strip()[:60]}' is no row of {width} numbers")
        rows.append(row)
    if not rows:
        raise InvalidConfig(f"'{path.name}' has no rows of taxels")
    return np.array(rows)
