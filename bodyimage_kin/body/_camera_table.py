"""The table ``[camera]`` of a file, and those of the models in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin import _checks
from bodyimage_kin._named import named_class
from bodyimage_kin.body._description import MODELS
from bodyimage_kin.body._rigid import rigid
from bodyimage_kin.body._tables import NEEDED, Table
from bodyimage_kin.body.cameras import Camera, Stereo, Tracker, VirtualScreen
from bodyimage_kin.body.pinhole import Pinhole
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.robot import transforms

_MOUNT = ("link", "link_T_camera", "position", "forward", "right")


def read_camera(table: Table, folder: Path) -> Camera | None:
    """The camera that a table tells; None where something in it is wrong.

    Args:
        table: ``[camera]``.
        folder: Where the file lies: a model of the user's own is looked for there.
    """
    link, pose = table.text("link"), _read_pose(table)
    model = _read_model(table, folder, {field: table.values[field] for field in table.values if field not in _MOUNT})
    table.close(_MOUNT)
    found: Camera | None = table.make(lambda: Camera(link, pose, model))
    return found


def unit_axes(table: Table) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None:
    """Unit vectors ``forward`` and ``right``, which must be orthogonal."""
    forward, right = table.numbers("forward", 3), table.numbers("right", 3)
    if forward is None or right is None:
        return None
    forward, right = np.array(forward), np.array(right)
    with np.errstate(over="ignore"):
        lengths = float(np.linalg.norm(forward)), float(np.linalg.norm(right))
    if max(lengths) == np.inf:
        table.note(InvalidConfig(f"{table.place}: 'forward' or 'right' is too long for a float64; give unit vectors"))
        return None
    if min(lengths) < 1e-9 or abs(forward @ right) > 1e-9 * lengths[0] * lengths[1]:
        table.note(InvalidConfig(f"{table.place}: 'forward' and 'right' must be orthogonal and not zero"))
        return None
    # What has length one already keeps its bits.
    scaled = [
        axis if abs(length - 1.0) < 1e-15 else axis / length
        for axis, length in zip((forward, right), lengths, strict=True)
    ]
    return scaled[0], scaled[1]


def _read_pose(table: Table) -> Any:
    """link_T_camera, written as such or as position, forward and right."""
    # Of a stereo camera `right` is the table of its right eye.
    axes_of_image = [field for field in ("forward", "right") if isinstance(table.values.get(field, {}), list)]
    if "link_T_camera" in table.values:
        doubled = [field for field in ("position", *axes_of_image) if field in table.values]
        if doubled:
            table.note(InvalidConfig(f"{table.place}: give 'link_T_camera' or {', '.join(doubled)}, not both"))
        return table.take("link_T_camera", rigid)
    if len(axes_of_image) < 2:
        table.note(
            InvalidConfig(
                f"{table.place}: give 'link_T_camera', four rows of four numbers, or 'forward' and 'right' (z and x of "
                "the image, in the link) and 'position'"
            )
        )
        return None
    axes, position = unit_axes(table), table.numbers("position", 3, default=(0.0, 0.0, 0.0))
    if axes is None or position is None:
        return None
    forward, right = axes
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    return transforms.transform(rotation, np.array(position))


def _read_model(table: Table, folder: Path, fields: Mapping[str, Any]) -> Any:
    """The model that a table names in ``model``.

    Args:
        table: The table.
        folder: As of :func:`read_camera`.
        fields: What the table has of a model of the user's own.
    """
    wanted = ", ".join(map(repr, MODELS))
    kind = table.take("model", _checks.text, wanted=f"one of {wanted}, or 'package.module:Class'")
    if kind is None:
        return None
    if kind not in MODELS:
        return _read_own(table, kind, folder, {name: value for name, value in fields.items() if name != "model"})
    if kind == "stereo":
        return _read_stereo(table, folder)
    if kind == "tracker":
        return table.make(Tracker)
    return _read_screen(table) if kind == "virtual_screen" else _read_pinhole(table)


def _read_screen(table: Table) -> Any:
    distance = table.number("distance", above=0.0)
    near = table.number("near", default=VirtualScreen.near, above=0.0)
    if "half_angle" in table.values:
        half_angle = table.number("half_angle", above=0.0, below=math.pi / 2)
    else:
        degrees = table.number("half_angle_degrees", default=60.0, above=0.0, below=90.0)
        half_angle = None if degrees is None else math.radians(degrees)
    return table.make(lambda: VirtualScreen(distance, near, half_angle))


def _read_pinhole(table: Table) -> Any:
    fx, fy = table.number("fx", above=0.0), table.number("fy", above=0.0)
    cx, cy = table.number("cx"), table.number("cy")
    distortion = table.numbers("distortion", None, default=())
    size = table.take("size", _whole_pair, default=None)
    near = table.number("near", default=Pinhole.near, least=0.0)
    return table.make(lambda: Pinhole(fx, fy, cx, cy, distortion, size, near))


def _read_stereo(table: Table, folder: Path) -> Any:
    sides: list[Any] = []
    for name in ("left", "right"):
        side = table.table(name)
        sides.append(None if side is None else _read_model(side, folder, side.values))
        if side is not None:
            side.close()
            table.broken |= side.broken
    pose = table.take("left_T_right", rigid, NEEDED, "four rows of four numbers")
    left, right = sides
    return table.make(lambda: Stereo(left, right, pose))


def _read_own(table: Table, kind: str, folder: Path, fields: dict[str, Any]) -> Any:
    """A model of the user's own: the class is found and looked at before anything is built of it."""
    for name in fields:
        table.take(name, lambda _, value: value)

    def build() -> Any:
        if ":" not in kind:
            raise InvalidConfig(str(UnknownName("camera model", kind, (*MODELS, "package.module:Class"))))
        own = named_class("camera model", kind, ("project",), folder)
        try:
            return own(**fields)
        except (TypeError, ValueError) as problem:
            raise InvalidConfig(
                f"camera model {kind!r} is not built of {', '.join(fields) or 'nothing'}: {problem}"
            ) from None

    return table.make(build)


def _whole_pair(field: str, value: Any) -> tuple[int, int]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        _checks.refuse(field, value, "width and height in pixels, both whole")
    return _checks.whole(f"{field}[0]", value[0], least=1), _checks.whole(f"{field}[1]", value[1], least=1)
