"""Where the taxels of a skin go: cast onto a link by rays, or given as points; checked, mended, and told in notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.body import graph
from bodyimage_kin.body._patch import Array3, Patch, cast_patch, cells
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Box, Capsule, Collision, Cylinder, Sphere
from bodyimage_kin.robot.shapes import Found, link_surface, place_shape

Points = Float[np.ndarray, "taxels 3"]
_SHORT = 1e-6
"""Normals shorter than this have no direction."""


def laid_by_rays(
    robot: Robot,
    link: str,
    shape: tuple[int, int],
    size: tuple[float, float],
    centre: ArrayLike,
    rays: tuple[ArrayLike, ArrayLike],
    landmarks: Mapping[str, Any] | None,
    reference: Any,
    eye: Any,
    on: Any,
    touch: tuple[ArrayLike | None, ArrayLike | None],
    mesh_folder: str | Path | None,
) -> dict[str, Any]:
    """The fields of a grid; see :meth:`bodyimage_kin.body.Skin.grid`."""
    if not isinstance(robot, Robot):
        raise InvalidConfig(f"skin: robot is {type(robot).__name__}; give a bk.Robot")
    robot.check_link(link)
    if np.shape(shape) != (2,):
        _checks.refuse("skin: shape", shape, "rows and columns, both positive")
    rows, columns = _checks.whole("skin: rows", shape[0], least=1), _checks.whole("skin: columns", shape[1], least=1)
    height, width = _checks.numbers_of("skin: size", size, 2, above=0.0)
    axes = _axes("forward", "right", *rays)
    patch = Patch((rows, columns), (height, width), np.array(_checks.numbers_of("skin: centre", centre, 3)), *axes)
    folder = None if mesh_folder is None else Path(mesh_folder)
    stated = _stated(on)
    found: Found = link_surface(robot, link, folder) if stated is None else place_shape(stated, link)
    cast = cast_patch(patch, found.surface, cells(patch.shape))
    there = ~np.isnan(cast.points).any(axis=1)
    missing, total = int((~there).sum()), len(there)
    if missing > total / 2:
        raise InvalidConfig(
            f"skin: {missing} of {total} taxels find no surface of link '{link}' to lie on; make 'size' smaller or "
            "move 'centre' forward"
        )
    notes = [*found.notes]
    if cast.beside.any():
        notes.append(
            f"the rays of {int(cast.beside.sum())} of {total} taxels pass beside link '{link}': these lie at the "
            "nearest place of it"
        )
    if missing:
        notes.append(
            f"{missing} of {total} cells find no surface of link '{link}' and have no taxel: the others are numbered "
            "without gaps; make 'size' smaller for a whole grid"
        )
    kept = np.flatnonzero(there)
    number = np.full(total, -1)
    number[kept] = np.arange(len(kept))
    places = _Places(number, (rows, columns), landmarks)
    edges = number[graph.grid_edges(rows, columns)]
    forward, right = axes if touch == (None, None) else _axes("touch_forward", "touch_right", *touch)
    middle = number[(rows // 2) * columns + columns // 2]
    return {
        "link": link,
        "positions": torch.from_numpy(cast.points[kept]),
        "normals": torch.from_numpy(cast.normals[kept]),
        "neighbours": edges[(edges >= 0).all(axis=1)],
        "forward": forward,
        "right": right,
        "landmarks": places.landmarks,
        "reference": max(int(middle), 0) if reference is None else places.taxel("reference", reference),
        "eye": None if eye is None else places.taxel("eye", eye),
        "layout": patch,
        "cells": kept if missing else None,
        "surface": found.surface,
        "stated": stated,
        "mesh_folder": folder,
        "notes": tuple(notes),
    }


def laid_by_points(
    positions: ArrayLike,
    normals: ArrayLike | None,
    neighbours: ArrayLike | None,
    link: str,
    frame: tuple[ArrayLike | None, ArrayLike | None],
    landmarks: Mapping[str, Any] | None,
    reference: Any,
    eye: Any,
    inside: ArrayLike,
    ids: ArrayLike | None,
    units: ArrayLike | None,
    mesh_folder: str | Path | None,
    notes: Sequence[str],
) -> dict[str, Any]:
    """The fields of a skin that is given; see :meth:`bodyimage_kin.body.Skin.points`."""
    _checks.text("skin: link", link)
    places = _rows("positions", positions)
    lost = np.flatnonzero(~np.isfinite(places).all(axis=1))
    if len(lost):
        raise InvalidConfig(
            f"skin: taxels {_few(lost)} have no place (not finite); leave them out, and give ids to the others"
        )
    notes = list(notes)
    middle = np.array(_checks.numbers_of("skin: inside", inside, 3))
    directions, said = _normals(places, None if normals is None else _rows("normals", normals, len(places)), middle)
    notes += said
    edges = graph.near_edges(places) if neighbours is None else _pairs(neighbours, len(places))
    notes += _told_of_graph(places, edges)
    named = _Places(np.arange(len(places)), None, landmarks)
    centre = int(np.linalg.norm(places - places.mean(0), axis=1).argmin())
    forward, right = _frame(directions, *frame)
    return {
        "link": link,
        "positions": torch.from_numpy(places),
        "normals": torch.from_numpy(directions),
        "in_link": (places, directions),
        "neighbours": edges,
        "forward": forward,
        "right": right,
        "landmarks": named.landmarks,
        "reference": centre if reference is None else named.taxel("reference", reference),
        "eye": None if eye is None else named.taxel("eye", eye),
        "ids": _numbers("ids", ids, len(places), distinct=True),
        "units": _numbers("units", units, len(places)),
        "mesh_folder": None if mesh_folder is None else Path(mesh_folder),
        "notes": tuple(notes),
    }


class _Places:
    """Taxels by name, number, or row and column."""

    def __init__(
        self, number: Int[np.ndarray, "cells"], shape: tuple[int, int] | None, landmarks: Mapping[str, Any] | None
    ) -> None:
        self._number, self._shape = number, shape
        self.landmarks: dict[str, int] = {}
        for name, place in (landmarks or {}).items():
            self.landmarks[name] = self.taxel(f"landmark '{name}'", place)

    def taxel(self, what: str, place: Any) -> int:
        if isinstance(place, str):
            if place not in self.landmarks:
                raise UnknownName(f"landmark for '{what}' of the skin", place, self.landmarks)
            return self.landmarks[place]
        if np.ndim(place) == 1 and len(place) == 2 and self._shape is not None:
            rows, columns = self._shape
            row = _checks.whole(f"skin: {what} row", place[0], least=0, most=rows - 1)
            cell = row * columns + _checks.whole(f"skin: {what} column", place[1], least=0, most=columns - 1)
        else:
            cell = _checks.whole(f"skin: {what}", place, least=0, most=len(self._number) - 1)
        if self._number[cell] < 0:
            raise InvalidConfig(f"skin: {what} is at cell {place!r}, where the grid has a hole; name another")
        return int(self._number[cell])


def _stated(on: Any) -> Collision | None:
    """A shape that is stated, in its place."""
    if isinstance(on, Sphere | Box | Cylinder | Capsule):
        return Collision(on)
    if on is None or (isinstance(on, Collision) and isinstance(on.shape, Sphere | Box | Cylinder | Capsule)):
        return on
    raise InvalidConfig(f"skin: on is {type(on).__name__}; give a Sphere, Box, Cylinder, Capsule or a Collision of one")


def _axes(first: str, second: str, forward: ArrayLike | None, right: ArrayLike | None) -> tuple[Array3, Array3]:
    """Orthogonal unit vectors; what has length one already keeps its bits."""
    if forward is None or right is None:
        raise InvalidConfig(f"skin: give both {first} and {second}")
    axes = [np.array(_checks.numbers_of(f"skin: {name}", one, 3)) for name, one in ((first, forward), (second, right))]
    lengths = [float(np.linalg.norm(axis)) for axis in axes]
    if min(lengths) < 1e-9 or abs(axes[0] @ axes[1]) > 1e-9 * lengths[0] * lengths[1]:
        raise InvalidConfig(f"skin: {first} and {second} must be orthogonal and not zero")
    one, other = (
        axis if abs(length - 1.0) < 1e-15 else axis / length for axis, length in zip(axes, lengths, strict=True)
    )
    return one, other


def _frame(normals: Points, forward: ArrayLike | None, right: ArrayLike | None) -> tuple[Array3, Array3]:
    """The frame of touch: as given, else the mean normal, and level."""
    if forward is None:
        mean = normals.mean(0)
        if np.linalg.norm(mean) < 1e-3:
            raise InvalidConfig("skin: its taxels face all ways alike; give forward and right, in the link")
        ahead = mean / np.linalg.norm(mean)
    else:
        ahead = np.array(_checks.numbers_of("skin: forward", forward, 3))
    if right is None:
        level = np.cross(ahead, [0.0, 0.0, 1.0])
        right = level if np.linalg.norm(level) > 1e-6 * np.linalg.norm(ahead) else [0.0, -1.0, 0.0]
    elif forward is None:
        # The mean normal is ours to turn, the given axis is not.
        aside = np.array(_checks.numbers_of("skin: right", right, 3))
        ahead = ahead - (ahead @ aside) / max(float(aside @ aside), 1e-12) * aside
    return _axes("forward", "right", ahead, right)


def _normals(places: Points, given: Points | None, inside: Array3) -> tuple[Points, list[str]]:
    """Outward unit normals, and what was mended of those given."""
    if given is None:
        return graph.normals_of(places, inside), []
    notes = []
    length = np.linalg.norm(given, axis=1)
    none = ~(length > _SHORT)
    # A unit vector keeps its bits.
    unit = np.abs(length - 1.0) < 1e-12
    directions = np.where(unit[:, None], given, given / np.where(none, 1.0, length)[:, None])
    if none.any():
        directions[none] = graph.normals_of(places, inside)[none]
        notes.append(
            f"normals of taxels {_few(np.flatnonzero(none))} have no direction: computed from those around them"
        )
    short = ~none & (np.abs(length - 1.0) > 1e-2)
    if short.any():
        notes.append(
            f"normals of {int(short.sum())} taxels are not of length 1 ({length[~none].min():.2g} to "
            f"{length[~none].max():.2g}): made so"
        )
    return directions, notes


def _told_of_graph(places: Points, edges: Int[np.ndarray, "edges 2"]) -> list[str]:
    notes = []
    _, first, counts = np.unique(places, axis=0, return_index=True, return_counts=True)
    if (counts > 1).any():
        doubled = np.sort(first[counts > 1])
        notes.append(f"{len(doubled)} places bear more than one taxel, first of each {_few(doubled)}")
    count, piece = graph.pieces(len(places), edges)
    if count > 1:
        alone = np.flatnonzero(np.bincount(piece, minlength=count)[piece] == 1)
        left = f"; taxels {_few(alone)} have no neighbour" if len(alone) else ""
        notes.append(f"its graph is in {count} pieces, between which distances are straight{left}")
    return notes


def _rows(what: str, values: ArrayLike, count: int | None = None) -> Points:
    array = as_float_array(values, f"skin: {what}", error=InvalidConfig).copy()
    if array.ndim != 2 or array.shape[1] != 3 or not len(array) or (count is not None and len(array) != count):
        wanted = f"({'taxels' if count is None else count}, 3), one row a taxel and at least one"
        raise InvalidConfig(f"skin: {what} have shape {array.shape}; give {wanted}")
    return array


def _pairs(values: ArrayLike, count: int) -> Int[np.ndarray, "edges 2"]:
    array = np.asarray(values)
    if array.size == 0:
        return np.empty((0, 2), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != 2 or array.dtype.kind not in "iu":
        raise InvalidConfig(f"skin: neighbours have shape {array.shape}; give (edges, 2) whole numbers of taxels")
    if array.min() < 0 or array.max() >= count or (array[:, 0] == array[:, 1]).any():
        raise InvalidConfig(f"skin: neighbours must be pairs of two different taxels, 0 to {count - 1}")
    return np.unique(np.sort(array.astype(np.int64), axis=1), axis=0)


def _numbers(what: str, values: ArrayLike | None, count: int, distinct: bool = False) -> Any:
    if values is None:
        return None
    array = np.asarray(values)
    if array.shape != (count,) or array.dtype.kind not in "iu":
        raise InvalidConfig(f"skin: {what} have shape {array.shape}; give one whole number a taxel, ({count},)")
    if distinct and len(np.unique(array)) < count:
        raise InvalidConfig(f"skin: {what} name a taxel twice; give each its own")
    return array.astype(np.int64)


def _few(taxels: Int[np.ndarray, "count"]) -> str:
    return ", ".join(map(str, taxels[:5])) + (f" ... ({len(taxels)})" if len(taxels) > 5 else "")
