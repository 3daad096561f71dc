"""Intrinsics that may be off: what of a camera's model is a number to be found, and how images move with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin.body import CameraModel, Pinhole, Stereo, VirtualScreen
from bodyimage_kin.estimators.parametric import Parameter

__all__ = ["Intrinsics"]

_DISTORTION = 10.0
"""How many times as far as a focal length, relatively, distortion coefficients may be off."""


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """The numbers of a camera's model.

    Attributes:
        model: As it is thought to be.
        parameters: Its numbers; none of a model of one's own, or of a tracker, which has none.
        changed: (model, values) -> the model with these added.
        slope: (model, points) -> (count, m, parameters) derivative of images [their unit].
    """

    model: CameraModel
    parameters: tuple[Parameter, ...]
    changed: Callable[[Any, Float[np.ndarray, "parameters"]], CameraModel]
    slope: Callable[[Any, Float[np.ndarray, "count 3"]], Float[np.ndarray, "count m parameters"]]

    @classmethod
    def of(cls, name: str, model: CameraModel) -> Intrinsics:
        """Those of a camera.

        Args:
            name: Of its mount.
            model: Its model.
        """
        if isinstance(model, VirtualScreen):
            parameters = (Parameter(f"{name}: distance of the screen", "intrinsics", "m", model.distance),)
            return cls(model, parameters, _with_distance, _of_distance)
        if isinstance(model, Pinhole):
            return cls(model, _of_pinhole(name, model), _with_pinhole, _slope_of_pinhole)
        if isinstance(model, Stereo):
            sides = [cls.of(f"{name}, {side}", one) for side, one in (("left", model.left), ("right", model.right))]
            return cls(
                model,
                tuple(parameter for side in sides for parameter in side.parameters),
                lambda changed, values: _with_sides(changed, sides, values),
                lambda changed, points: _slope_of_sides(changed, sides, points),
            )
        return cls.held(model)

    @classmethod
    def held(cls, model: CameraModel) -> Intrinsics:
        """Those of a camera whose numbers are known."""
        return cls(
            model, (), lambda changed, values: changed, lambda changed, points: np.zeros((len(points), model.m, 0))
        )

    def at(self, values: Float[np.ndarray, "parameters"]) -> CameraModel:
        """The model with these numbers added."""
        return self.changed(self.model, values) if values.any() else self.model


def _with_distance(model: VirtualScreen, values: Float[np.ndarray, "1"]) -> VirtualScreen:
    return replace(model, distance=model.distance + float(values[0]))


def _of_distance(model: VirtualScreen, points: Float[np.ndarray, "count 3"]) -> Float[np.ndarray, "count 2 1"]:
    return np.asarray(model.project(torch.from_numpy(points)).numpy()[..., None] / model.distance)


def _of_pinhole(name: str, model: Pinhole) -> tuple[Parameter, ...]:
    focal = (model.fx + model.fy) / 2
    found = [Parameter(f"{name}: {field}", "intrinsics", "px", focal) for field in ("fx", "fy", "cx", "cy")]
    names = ("k1", "k2", "p1", "p2", "k3")[: len(model.distortion)]
    return (*found, *(Parameter(f"{name}: {field}", "intrinsics", "1", _DISTORTION) for field in names))


def _with_pinhole(model: Pinhole, values: Float[np.ndarray, "parameters"]) -> Pinhole:
    fx, fy, cx, cy = (float(value) for value in values[:4])
    return replace(
        model,
        fx=model.fx + fx,
        fy=model.fy + fy,
        cx=model.cx + cx,
        cy=model.cy + cy,
        distortion=tuple(float(value) for value in np.add(model.distortion, values[4:])),
    )


def _slope_of_pinhole(model: Pinhole, points: Float[np.ndarray, "count 3"]) -> Float[np.ndarray, "count 2 parameters"]:
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    s = x**2 + y**2
    image = model.project(torch.from_numpy(points)).numpy()
    zero, one = np.zeros_like(x), np.ones_like(x)
    across, down = (image[:, 0] - model.cx) / model.fx, (image[:, 1] - model.cy) / model.fy
    columns = [(across, zero), (zero, down), (one, zero), (zero, one)]
    # The distorted place is linear in the coefficients.
    of_distortion = [
        (x * s, y * s),
        (x * s**2, y * s**2),
        (2 * x * y, s + 2 * y**2),
        (s + 2 * x**2, 2 * x * y),
        (x * s**3, y * s**3),
    ]
    columns += [(model.fx * a, model.fy * b) for a, b in of_distortion[: len(model.distortion)]]
    return np.stack([np.stack(column, axis=1) for column in columns], axis=2)


def _with_sides(model: Stereo, sides: list[Intrinsics], values: Float[np.ndarray, "parameters"]) -> Stereo:
    cut = len(sides[0].parameters)
    return replace(
        model, left=sides[0].changed(model.left, values[:cut]), right=sides[1].changed(model.right, values[cut:])
    )


def _slope_of_sides(
    model: Stereo, sides: list[Intrinsics], points: Float[np.ndarray, "count 3"]
) -> Float[np.ndarray, "count m parameters"]:
    pose = np.asarray(model.left_T_right)
    in_right = (points - pose[:3, 3]) @ pose[:3, :3]
    left, right = sides[0].slope(model.left, points), sides[1].slope(model.right, in_right)
    found = np.zeros((len(points), left.shape[1] + right.shape[1], left.shape[2] + right.shape[2]))
    found[:, : left.shape[1], : left.shape[2]] = left
    found[:, left.shape[1] :, left.shape[2] :] = right
    return found
