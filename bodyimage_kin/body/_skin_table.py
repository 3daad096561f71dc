"""The table ``[skin]`` of a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body._build import Lay
from bodyimage_kin.body._camera_table import unit_axes
from bodyimage_kin.body._rigid import rigid
from bodyimage_kin.body._tables import NEEDED, Table
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Box, Capsule, Collision, Cylinder, Sphere
from bodyimage_kin.robot.transforms import Vector

KINDS = {"sphere": Sphere, "box": Box, "cylinder": Cylinder, "capsule": Capsule}
"""The kind of a stated shape in a file -> its class."""

_MOST_TAXELS = 10**6
"""Of a grid: a ray is cast for each."""


def read_skin(table: Table, folder: Path) -> tuple[str, Lay] | None:
    """The link that a skin lies on, and what lays it there; None where something in the table is wrong.

    Args:
        table: ``[skin]``.
        folder: Where the file lies, from which paths in it lead.
    """
    link = table.text("link")
    meshes = table.take("mesh_folder", lambda name, value: folder / _checks.text(name, value), default=None)
    moved = table.take("link_T_skin", rigid, default=None)
    given = "positions" in table.values or "table" in table.values
    made = _read_points(table, folder) if given else _read_grid(table)
    table.close()
    if table.broken or made is None:
        return None

    def lay(robot: Robot, root_T_link: Float[Tensor, "4 4"]) -> Skin:
        skin = made(robot, link, meshes)
        return (skin if moved is None else skin.moved(moved)).borne_by(robot, root_T_link)

    return link, lay


_Made = Callable[[Robot, str, Path | None], Skin]


def _read_grid(table: Table) -> _Made | None:
    axes = unit_axes(table)
    shape = table.take("shape", _rows_and_columns, wanted="[rows, columns], both positive")
    size, centre = table.numbers("size", 2, above=0.0), table.numbers("centre", 3)
    landmarks = _read_landmarks(table.table("landmarks", default=None), shape)
    reference = _read_place(table, "reference", landmarks, shape)
    eye = _read_place(table, "eye", landmarks, shape, default=None)
    touch = {name: table.numbers(name, 3, default=None) for name in ("touch_forward", "touch_right")}
    on = table.table("on", default=None)
    stated = None if on is None else _read_stated(on)
    if table.broken or axes is None or landmarks is None or (on is not None and stated is None):
        table.broken = True
        return None
    settings = {"shape": shape, "size": size, "centre": centre, "forward": axes[0], "right": axes[1], "on": stated}
    places = {"landmarks": landmarks, "reference": reference, "eye": eye}
    return lambda robot, link, meshes: Skin.grid(robot, link, mesh_folder=meshes, **settings, **places, **touch)


def _read_points(table: Table, folder: Path) -> _Made | None:
    for field in ("shape", "size", "centre", "on"):
        if field in table.values:
            table.note(
                InvalidConfig(f"{table.place}: '{field}' is of a grid, '{_points_field(table)}' of points; give one")
            )
            table.take(field, lambda _, value: value)
    if "table" in table.values:
        columns = table.take("table", lambda name, value: _read_file(name, folder / _checks.text(name, value)))
        positions, normals = columns or (None, None)
    else:
        positions = table.take("positions", _numbers(3))
        normals = table.take("normals", _numbers(3), default=None)
    count = 10**9 if positions is None else len(positions)
    landmarks = _read_landmarks(table.table("landmarks", default=None), None, count)
    settings = {
        "neighbours": table.take("neighbours", _pairs, default=None),
        "reference": _read_place(table, "reference", landmarks, None, None, count),
        "eye": _read_place(table, "eye", landmarks, None, None, count),
        "forward": table.numbers("forward", 3, default=None),
        "right": table.numbers("right", 3, default=None),
        "inside": table.numbers("inside", 3, default=(0.0, 0.0, 0.0)),
        "ids": table.take("ids", _wholes, default=None),
        "units": table.take("units", _wholes, default=None),
    }
    if table.broken or landmarks is None:
        table.broken = True
        return None

    def make(robot: Robot, link: str, meshes: Path | None) -> Skin:
        return Skin.points(
            positions, normals, link=robot.check_link(link), landmarks=landmarks, mesh_folder=meshes, **settings
        )

    return make


def _points_field(table: Table) -> str:
    return "table" if "table" in table.values else "positions"


def _read_file(field: str, path: Path) -> tuple[Float[np.ndarray, "taxels 3"], Float[np.ndarray, "taxels 3"] | None]:
    """Places, and normals where there are any, of a text file of three or six numbers a row."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        raise InvalidConfig(f"{field}: cannot read '{path}': {problem}") from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            if not rows:  # names of columns
                continue
            raise InvalidConfig(f"{field}: line {number} of '{path}' is no row of numbers") from None
        if row and len(row) not in (3, 6):
            raise InvalidConfig(
                f"{field}: line {number} of '{path}' has {len(row)} numbers; give x, y, z [m], and a normal or none"
            )
        if row and rows and len(row) != len(rows[0]):
            raise InvalidConfig(f"{field}: line {number} of '{path}' has {len(row)} numbers, others {len(rows[0])}")
        if row:
            rows.append(row)
    if not rows:
        raise InvalidConfig(f"{field}: '{path}' has no row of numbers")
    values = np.array(rows)
    return values[:, :3], values[:, 3:] if values.shape[1] == 6 else None


def _read_stated(table: Table) -> Collision | None:
    """A shape to lie on, in the link."""
    kind = table.take(
        "kind", lambda name, value: _checks.choice(name, value, KINDS), wanted=f"one of {', '.join(map(repr, KINDS))}"
    )
    sizes: dict[str, Any] = {}
    if kind == "box":
        sizes["size"] = table.numbers("size", 3, above=0.0)
    elif kind is not None:
        sizes["radius"] = table.number("radius", above=0.0)
        if kind in ("cylinder", "capsule"):
            sizes["length"] = table.number("length", above=0.0)
    xyz: Vector = table.numbers("xyz", 3, default=(0.0, 0.0, 0.0))
    rpy: Vector = table.numbers("rpy", 3, default=(0.0, 0.0, 0.0))
    table.close()
    return None if table.broken or kind is None else Collision(KINDS[kind](**sizes), xyz, rpy)


def _read_landmarks(
    table: Table | None, shape: tuple[int, int] | None, count: int | None = None
) -> dict[str, int] | None:
    """Name -> cell of a grid, or taxel; None where one is wrong."""
    if table is None:
        return {}
    found = {name: _read_taxel(table, name, shape, count) for name in table.values}
    table.close()
    return None if None in found.values() else found


def _read_place(
    table: Table,
    field: str,
    landmarks: dict[str, int] | None,
    shape: Any,
    default: Any = NEEDED,
    count: int | None = None,
) -> Any:
    """A taxel, by the name of a landmark, or as [row, column] of a grid, or by its number."""
    if field in table.values and not isinstance(table.values[field], str):
        return _read_taxel(table, field, shape, count)

    def check(name: str, value: Any) -> int | None:
        _checks.text(name, value)
        if landmarks is not None and value not in landmarks:
            raise UnknownName(f"landmark for '{field}' in {table.place}", value, landmarks)
        return None if landmarks is None else landmarks[value]

    other = "[row, column]" if count is None else "the number of a taxel"
    return table.take(field, check, default, f"the name of a landmark, or {other}")


def _read_taxel(table: Table, field: str, shape: tuple[int, int] | None, count: int | None = None) -> Any:
    """The taxel at [row, column] of a grid, or of a number."""
    rows, columns = shape or (10**9, 10**9)

    def check(name: str, value: Any) -> int:
        if count is not None:
            return _checks.whole(name, value, least=0, most=count - 1)
        if not isinstance(value, list) or len(value) != 2:
            _checks.refuse(name, value, f"[row, column] within {rows} x {columns}")
        row = _checks.whole(f"{name} row", value[0], least=0, most=rows - 1)
        return row * columns + _checks.whole(f"{name} column", value[1], least=0, most=columns - 1)

    return table.take(field, check)


def _numbers(width: int) -> Callable[[str, Any], Float[np.ndarray, "rows width"]]:
    def check(name: str, value: Any) -> Float[np.ndarray, "rows width"]:
        if not isinstance(value, list) or not value:
            _checks.refuse(name, value, f"a list of rows of {width} numbers")
        return np.array([_checks.numbers_of(f"{name}[{row}]", one, width) for row, one in enumerate(value)])

    return check


def _wholes(name: str, value: Any) -> list[int]:
    if not isinstance(value, list):
        _checks.refuse(name, value, "a list of whole numbers, one a taxel")
    return [_checks.whole(f"{name}[{row}]", one, least=0) for row, one in enumerate(value)]


def _pairs(name: str, value: Any) -> list[list[int]]:
    if not isinstance(value, list):
        _checks.refuse(name, value, "a list of pairs of taxels")
    return [_wholes(f"{name}[{row}]", one) for row, one in enumerate(value)]


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
