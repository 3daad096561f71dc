"""A body told in plain values: what its file holds, what its hash is of, and what two equal bodies share."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from bodyimage_kin.body.cameras import Camera, Stereo, Tracker, VirtualScreen
from bodyimage_kin.body.hand import Hand
from bodyimage_kin.body.pinhole import Pinhole
from bodyimage_kin.body.skin import Patch, Skin
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.robot.geometry import Collision
from bodyimage_kin.robot.triangles import Triangles

if TYPE_CHECKING:
    from bodyimage_kin.body.embodiment import Embodiment

MODELS: Mapping[str, type] = {
    "virtual_screen": VirtualScreen,
    "pinhole": Pinhole,
    "stereo": Stereo,
    "tracker": Tracker,
}
"""The name of a camera model in a file -> its class."""


def describe(body: Embodiment, strict: bool = True) -> dict[str, Any]:
    """A body as tables of plain values; reading them back gives an equal body.

    Args:
        body: The embodiment.
        strict: Refuse what no table can hold; else such a thing is told by its class alone.

    Raises:
        InvalidConfig: A camera model of one's own that holds more than plain values.
    """
    zero = torch.minimum(torch.maximum(torch.zeros_like(body.home), body.robot.lower), body.robot.upper)
    named = zip(body.robot.joint_names, body.home.tolist(), zero.tolist(), strict=True)
    tables: dict[str, Any] = {
        "name": body.name,
        "joints": list(body.joints),
        "home": {joint: value for joint, value, without in named if value != without},
        "hand": _hand(body.hand),
        "camera": _camera(body.camera, strict),
    }
    if body.skin is not None:
        tables["skin"] = _skin(body.skin, strict)
    return tables


def _hand(hand: Hand) -> dict[str, Any]:
    return {"link": hand.link, "offset": hand.offset.tolist(), "radius": hand.radius}


def _camera(camera: Camera, strict: bool) -> dict[str, Any]:
    pose = camera.link_T_camera.tolist()
    return {"link": camera.link, "link_T_camera": pose, **_model(camera.model, strict)}


def _model(model: object, strict: bool) -> dict[str, Any]:
    kind = next((name for name, known in MODELS.items() if type(model) is known), None)
    place = f"{type(model).__module__}:{type(model).__qualname__}"
    if dataclasses.is_dataclass(model):
        held = {field.name: getattr(model, field.name) for field in dataclasses.fields(model)}
    else:
        held = dict(vars(model)) if hasattr(model, "__dict__") else {}
    plain = {name: _plain(f"{place}: {name}", value, strict) for name, value in held.items() if value is not None}
    return {"model": kind or place, **plain}


def _plain(field: str, value: object, strict: bool) -> Any:
    if isinstance(value, bool | int | float | str):
        if isinstance(value, float) and not math.isfinite(value) and strict:
            raise InvalidConfig(f"{field} is {value}, which no file can hold")
        return value
    if isinstance(value, np.ndarray | np.generic | torch.Tensor):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(field, item, strict) for item in value]
    if hasattr(value, "project"):
        return _model(value, strict)
    if strict:
        raise InvalidConfig(
            f"{field} is {type(value).__name__}, which no file can hold; let a camera model be a dataclass of numbers, "
            "texts and lists"
        )
    return f"{type(value).__module__}:{type(value).__qualname__}"


def _skin(skin: Skin, strict: bool) -> dict[str, Any]:
    meshes = {} if skin.mesh_folder is None or not strict else {"mesh_folder": skin.mesh_folder.as_posix()}
    laid = _points(skin) if skin.layout is None else _grid(skin, skin.layout)
    # What a mesh's file holds is no part of the robot's source.
    on_mesh = any(isinstance(shape, Triangles) for shape in skin.surface or ())
    places = {"places": skin.link_positions.round(6).tolist()} if on_mesh and not strict else {}
    return {"link": skin.link, **laid, **meshes, **places}


def _grid(skin: Skin, patch: Patch) -> dict[str, Any]:
    columns = patch.shape[1]
    cells = np.arange(skin.count) if skin.cells is None else skin.cells

    def place(taxel: int) -> list[int]:
        return list(divmod(int(cells[taxel]), columns))

    by_taxel = {taxel: name for name, taxel in reversed(list(skin.landmarks.items()))}
    landmarks = {name: place(taxel) for name, taxel in skin.landmarks.items()}
    own = np.array_equal(skin.forward, patch.forward) and np.array_equal(skin.right, patch.right)
    touch = {} if own else {"touch_forward": skin.forward.tolist(), "touch_right": skin.right.tolist()}
    return {
        "shape": list(patch.shape),
        "size": list(patch.size),
        "centre": patch.centre.tolist(),
        "forward": patch.forward.tolist(),
        "right": patch.right.tolist(),
        "reference": by_taxel.get(skin.reference, place(skin.reference)),
        **({} if skin.eye is None else {"eye": by_taxel.get(skin.eye, place(skin.eye))}),
        **touch,
        **({} if np.array_equal(skin.link_T_skin, np.eye(4)) else {"link_T_skin": skin.link_T_skin.tolist()}),
        **({} if skin.stated is None else {"on": _stated(skin.stated)}),
        **({"landmarks": landmarks} if landmarks else {}),
    }


def _points(skin: Skin) -> dict[str, Any]:
    by_taxel = {taxel: name for name, taxel in reversed(list(skin.landmarks.items()))}
    numbers = {"ids": skin.ids, "units": skin.units}
    return {
        "positions": skin.link_positions.tolist(),
        "normals": skin.link_normals.tolist(),
        "neighbours": skin.neighbours.tolist(),
        "forward": skin.forward.tolist(),
        "right": skin.right.tolist(),
        "reference": by_taxel.get(skin.reference, skin.reference),
        **({} if skin.eye is None else {"eye": by_taxel.get(skin.eye, skin.eye)}),
        **{name: values.tolist() for name, values in numbers.items() if values is not None},
        **({"landmarks": dict(skin.landmarks)} if skin.landmarks else {}),
    }


def _stated(stated: Collision) -> dict[str, Any]:
    kind = type(stated.shape).__name__.lower()
    return {"kind": kind, **dataclasses.asdict(stated.shape), "xyz": list(stated.xyz), "rpy": list(stated.rpy)}
