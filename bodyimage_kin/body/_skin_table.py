"""The table ``[skin]`` of a file."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body._build import Lay
from bodyimage_kin.body._camera_table import unit_axes
from bodyimage_kin.body._tables import NEEDED, Table
from bodyimage_kin.body.skin import Patch, Skin
from bodyimage_kin.errors import UnknownName
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.shapes import collision_shapes

_MOST_TAXELS = 10**6
"""Of a grid: a ray is cast for each."""


def read_skin(table: Table) -> tuple[str, Lay] | None:
    """The link that a skin lies on, and what lays it there; None where something in the table is wrong."""
    link, axes = table.text("link"), unit_axes(table)
    shape = table.take("shape", _rows_and_columns, wanted="[rows, columns], both positive")
    size, centre = table.numbers("size", 2, above=0.0), table.numbers("centre", 3)
    landmarks = _read_landmarks(table.table("landmarks", default=None), shape)
    reference = _read_place(table, "reference", landmarks, shape)
    eye = _read_place(table, "eye", landmarks, shape, default=None)
    table.close()
    if table.broken or axes is None or landmarks is None:
        return None
    patch = Patch(shape, (size[0], size[1]), np.array(centre), *axes)

    def lay(robot: Robot, root_T_link: Float[Tensor, "4 4"]) -> Skin:
        return Skin.lay(link, patch, collision_shapes(robot, link), root_T_link, landmarks, reference, eye)

    return link, lay


def _read_landmarks(table: Table | None, shape: tuple[int, int] | None) -> dict[str, int] | None:
    """Name -> taxel; None where one is wrong."""
    if table is None:
        return {}
    found = {name: _read_taxel(table, name, shape) for name in table.values}
    table.close()
    return None if None in found.values() else found


def _read_place(table: Table, field: str, landmarks: dict[str, int] | None, shape: Any, default: Any = NEEDED) -> Any:
    """A taxel, by the name of a landmark or as [row, column]."""
    if isinstance(table.values.get(field), list):
        return _read_taxel(table, field, shape)

    def check(name: str, value: Any) -> int | None:
        _checks.text(name, value)
        if landmarks is not None and value not in landmarks:
            raise UnknownName(f"landmark for '{field}' in {table.place}", value, landmarks)
        return None if landmarks is None else landmarks[value]

    return table.take(field, check, default, "the name of a landmark, or [row, column]")


def _read_taxel(table: Table, field: str, shape: tuple[int, int] | None) -> Any:
    """The taxel at [row, column]."""
    rows, columns = shape or (10**9, 10**9)

    def check(name: str, value: Any) -> int:
        if not isinstance(value, list) or len(value) != 2:
            _checks.refuse(name, value, f"[row, column] within {rows} x {columns}")
        row = _checks.whole(f"{name} row", value[0], least=0, most=rows - 1)
        return row * columns + _checks.whole(f"{name} column", value[1], least=0, most=columns - 1)

    return table.take(field, check)


def _rows_and_columns(name: str, value: Any) -> tuple[int, int]:
    if not isinstance(value, list) or len(value) != 2:
        _checks.refuse(name, value, "[rows, columns], both positive")
    rows, columns = (
        _checks.whole(f"{name} {what}", count, least=1, most=_MOST_TAXELS)
        for what, count in zip(("rows", "columns"), value, strict=True)
    )
    if rows * columns > _MOST_TAXELS:
        _checks.refuse(name, value, f"a grid of at most {_MOST_TAXELS} taxels")
    return rows, columns
