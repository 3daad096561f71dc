"""The visuals of a URDF robot as triangles, placed by the robot's joints."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int

from bodyimage_kin.backends import kinematics
from bodyimage_kin.errors import UnknownName
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Capsule, Cylinder, Shape, Sphere, Visual
from bodyimage_kin.robot.meshes import triangulate
from bodyimage_kin.robot.upright import is_turned

__all__ = ["PLAIN", "Surface", "link_poses", "link_surfaces", "sticks", "triangles"]

PLAIN = (0.82, 0.80, 0.77, 1.0)
_BLACK, _GREY = 0.02, (0.5, 0.5, 0.5)
"""Black shows no shape, and in files it often stands for a texture: it is drawn grey."""


class Surface(NamedTuple):
    """Triangles of a robot in its root's coordinates, or of a link in its own.

    Attributes:
        corners: [m], counterclockwise seen from outside.
        normals: Outward unit normals of the shape at the corners (of a sphere, not of the facets that stand for it).
        colours: RGBA of each triangle, 0 to 1.
        links: Index of each triangle's link in ``link_names``.
        link_names: Every link of the robot, in the file's order.
    """

    corners: Float[np.ndarray, "triangles 3 3"]
    normals: Float[np.ndarray, "triangles 3 3"]
    colours: Float[np.ndarray, "triangles 4"]
    links: Int[np.ndarray, "triangles"]
    link_names: tuple[str, ...]


def triangles(
    robot: Robot,
    posture: Mapping[str, Any],
    *,
    links: Iterable[str] | None = None,
    mesh_folder: str | os.PathLike[str] | None = None,
) -> Surface:
    """The visuals of a robot at a posture.

    Args:
        robot: Whose visuals.
        posture: Joint values by name [rad or m]; the others are 0, mimic joints follow.
        links: The links to draw; None for all.
        mesh_folder: Where meshes may be read, subfolders included; None: the robot's own ``mesh_folder``, or beside its
            file.

    Returns:
        The triangles in the root, coloured as the materials say. A visual that cannot be read is left out, as
        ``robot.notes`` says. Of a robot without any, rods between its joints.

    Raises:
        UnknownName: A joint or link that the robot does not have.
        InvalidPosture: A joint value that is not finite.
        InvalidGeometry: A mesh that is missing or outside ``mesh_folder``.
    """
    poses = link_poses(robot, posture)
    parts = [
        part._replace(corners=part.corners @ pose[:3, :3].T + pose[:3, 3], normals=part.normals @ pose[:3, :3].T)
        for name, part in link_surfaces(robot, links, mesh_folder).items()
        for pose in (poses[name],)
    ]
    return _joined(parts, robot.link_names)


def link_surfaces(
    robot: Robot, links: Iterable[str] | None = None, mesh_folder: str | os.PathLike[str] | None = None
) -> dict[str, Surface]:
    """The visuals of each link that has some, in the link's own coordinates.

    Args:
        robot: Whose visuals; of a robot without any, rods between its joints.
        links: The links; None for all.
        mesh_folder: As of :func:`triangles`.

    Raises:
        UnknownName: As :func:`triangles`.
        InvalidGeometry: As :func:`triangles`.
    """
    wanted = set(robot.link_names if links is None else links)
    for name in sorted(wanted.difference(robot.link_names)):
        raise UnknownName("link", name, robot.link_names)
    folder = robot.mesh_folder if mesh_folder is None else Path(mesh_folder)
    visuals = {name: robot.geometry[name].visuals for name in robot.link_names}
    if not any(visuals.values()):
        visuals = sticks(robot)
    found, turn = {}, is_turned(robot, folder)
    for index, name in enumerate(robot.link_names):
        parts = []
        for visual in visuals[name] if name in wanted else ():
            mesh = triangulate(visual.shape, name, robot.file, folder, turn)
            rotation, position = visual.origin[:3, :3], visual.origin[:3, 3]
            parts.append(
                Surface(
                    np.asarray(mesh.triangles) @ rotation.T + position,
                    _normals(visual.shape, mesh) @ rotation.T,
                    _colours(visual, mesh),
                    np.full(len(mesh.faces), index),
                    robot.link_names,
                )
            )
        if parts:
            found[name] = _joined(parts, robot.link_names)
    return found


def _joined(parts: Sequence[Surface], link_names: tuple[str, ...]) -> Surface:
    nothing = Surface(
        np.empty((0, 3, 3)), np.empty((0, 3, 3)), np.empty((0, 4)), np.empty(0, dtype=np.int64), link_names
    )
    every = [nothing, *parts]
    return Surface(
        np.concatenate([one.corners for one in every]),
        np.concatenate([one.normals for one in every]),
        np.concatenate([one.colours for one in every]),
        np.concatenate([one.links for one in every]),
        link_names,
    )


def link_poses(robot: Robot, posture: Mapping[str, Any]) -> dict[str, Float[np.ndarray, "4 4"]]:
    """``root_T_link`` of every link at a posture given by joint names (the others at 0).

    Raises:
        UnknownName: A joint that the robot does not have, or that follows another.
        InvalidPosture: A value that is not finite.
    """
    q = robot.posture(posture, base=np.zeros(robot.n))
    # Nothing is to be compiled for a picture.
    kin = kinematics(robot, "torch")
    return {link: kin.pose(q, link).numpy() for link in robot.link_names}


def sticks(robot: Robot) -> dict[str, tuple[Visual, ...]]:
    """A ball for each link, and a rod from it to each link that hangs from it."""
    # Of its longest limb: a hand with many fingers must not make the rods thicker than the arm is long.
    size = max(_length(robot, link) for link in robot.link_names) or 1.0
    ball, rod = 0.016 * size, 0.007 * size
    found = {name: [Visual(Sphere(ball))] for name in robot.link_names}
    for joint in robot.tree.joints:
        x, y, z = joint.xyz
        length = float(np.linalg.norm(joint.xyz))
        if length > 0:
            along = (0.0, float(np.arccos(z / length)), float(np.arctan2(y, x)))
            found[joint.parent].append(Visual(Cylinder(rod, length), (x / 2, y / 2, z / 2), along))
    return {name: tuple(of) for name, of in found.items()}


def _length(robot: Robot, link: str) -> float:
    """Of the rods from the root to a link [m]."""
    return float(sum(np.linalg.norm(joint.xyz) for joint in robot.path(link)))


def _normals(shape: Shape, mesh: trimesh.Trimesh) -> Float[np.ndarray, "triangles 3 3"]:
    corners = np.asarray(mesh.triangles)
    if isinstance(shape, Sphere):
        return corners / shape.radius
    if isinstance(shape, Capsule):
        axis = np.clip(corners[..., 2:], -shape.length / 2, shape.length / 2) * [0.0, 0.0, 1.0]
        return (corners - axis) / np.linalg.norm(corners - axis, axis=-1, keepdims=True)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = np.repeat(flat[:, None], 3, axis=1) / np.linalg.norm(flat, axis=1).clip(1e-300)[:, None, None]
    if isinstance(shape, Cylinder):
        around = corners * [1, 1, 0] / shape.radius
        return np.where(np.abs(flat[..., 2:]) > 0.5, flat, around)
    return flat


def _colours(visual: Visual, mesh: trimesh.Trimesh) -> Float[np.ndarray, "triangles 4"]:
    if visual.colour is not None:
        colour = visual.colour if max(visual.colour[:3]) > _BLACK else (*_GREY, visual.colour[3])
        return np.tile(colour, (len(mesh.faces), 1))
    painted: Any = mesh.visual
    if painted.kind in ("face", "vertex"):
        return np.asarray(painted.face_colors, dtype=np.float64) / 255
    return np.tile(PLAIN, (len(mesh.faces), 1))
