"""Tables of Denavit and Hartenberg's parameters as kinematic trees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, get_args

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.robot import transforms
from bodyimage_kin.robot.tree import Joint, JointKind, KinematicTree

__all__ = ["read_table"]

_KINDS: Final[dict[str, JointKind]] = {kind: kind for kind in get_args(JointKind)}
_Z: Final = (0.0, 0.0, 1.0)
_Place = tuple[str, JointKind, str, str]
_Row = tuple[float, ...]


def read_table(
    rows: ArrayLike,
    convention: str,
    *,
    kinds: Sequence[str] | None,
    joints: Sequence[str] | None,
    links: Sequence[str] | None,
    limits: Sequence[ArrayLike | None] | None,
    name: str,
) -> KinematicTree:
    """The tree of a table; see :meth:`bodyimage_kin.Robot.from_dh`.

    Raises:
        InvalidConfig: Rows, kinds, names or limits that do not fit together.
    """
    classic = _checks.choice("convention", convention, ("classic", "modified")) == "classic"
    table = as_float_array(rows, "rows", ndim=2, error=InvalidConfig)
    if table.ndim != 2 or table.shape[1] != 4:
        raise InvalidConfig(f"rows has shape {table.shape}; give a, d, alpha and offset of each row")
    values = [_checks.numbers_of(f"rows[{index}]", row, 4) for index, row in enumerate(table)]
    count = len(values)
    joint_names = _names("joints", joints, count, [f"joint{index + 1}" for index in range(count)])
    link_names = _names("links", links, count + 1, [f"link{index}" for index in range(count + 1)])
    found: list[Joint] = []
    for index, row in enumerate(values):
        kind = _KINDS[_checks.choice(f"kinds[{index}]", _item("kinds", kinds, index, count, "revolute"), _KINDS)]
        limit = _item("limits", limits, index, count, None)
        lower, upper = _limits(f"limits[{index}]", limit, kind)
        place = joint_names[index], kind, link_names[index], link_names[index + 1]
        found += (_classic if classic else _modified)(place, row, lower, upper)
    tree_links = [link_names[0], *(joint.child for joint in found)]
    if len(set(tree_links)) < len(tree_links) or len({joint.name for joint in found}) < len(found):
        raise InvalidConfig("joints and links: two of the names are the same; give each its own")
    return KinematicTree(_checks.text("name", name), link_names[0], tuple(tree_links), tuple(found))


def _classic(place: _Place, row: _Row, lower: float, upper: float) -> Iterator[Joint]:
    """A joint about z of the frame before, and the row's transform fixed to what it turns."""
    name, kind, parent, child = place
    a, d, alpha, offset = row
    xyz, rpy = (a * math.cos(offset), a * math.sin(offset), d), (alpha, 0.0, offset)
    if kind == "fixed":
        yield Joint(name, kind, parent, child, xyz, rpy)
        return
    turned = f"{name}_turned"
    yield Joint(name, kind, parent, turned, axis=_Z, lower=lower, upper=upper)
    yield Joint(f"{name}_frame", "fixed", turned, child, xyz, rpy)


def _modified(place: _Place, row: _Row, lower: float, upper: float) -> Iterator[Joint]:
    """A joint about z of the frame itself, which the row's transform places."""
    name, kind, parent, child = place
    a, d, alpha, offset = row
    xyz = (a, -d * math.sin(alpha), d * math.cos(alpha))
    rpy = (alpha, 0.0, 0.0)
    if offset != 0.0:
        turn = transforms.rpy_matrix(rpy) @ transforms.rpy_matrix((0.0, 0.0, offset))
        rpy = transforms.matrix_rpy(turn)
    axis = (1.0, 0.0, 0.0) if kind == "fixed" else _Z
    yield Joint(name, kind, parent, child, xyz, rpy, axis, lower, upper)


def _names(field: str, names: Sequence[str] | None, count: int, default: list[str]) -> list[str]:
    if names is None:
        return default
    if isinstance(names, str) or len(names) != count:
        _checks.refuse(field, names, f"{count} names")
    return [_checks.text(f"{field}[{index}]", name) for index, name in enumerate(names)]


def _item(field: str, values: Sequence[object] | None, index: int, count: int, default: object) -> object:
    if values is None:
        return default
    if isinstance(values, str) or len(values) != count:
        _checks.refuse(field, values, f"{count} values, one a row")
    return values[index]


def _limits(field: str, limit: object, kind: JointKind) -> tuple[float, float]:
    if kind == "fixed":
        return 0.0, 0.0
    if limit is None or kind == "continuous":
        return -math.inf, math.inf
    lower, upper = _checks.numbers_of(field, limit, 2)
    if lower > upper:
        _checks.refuse(field, limit, "the lower limit first")
    return lower, upper
