"""Whether the COLLADA files of a robot mean it when they say that y is up.

Such a file names its axis that points up. Most readers of robots pass over that, and most robots were drawn for these;
some were drawn for readers that turn y up to z up, and lie in pieces elsewhere. Centres of mass, which the URDF gives
beside, tell the two apart.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot.geometry import Collision, Mesh, Visual
from bodyimage_kin.robot.meshes import TURN, load_mesh, mesh_path, names_y_up

if TYPE_CHECKING:
    from bodyimage_kin.robot import Robot

__all__ = ["is_turned"]

_CLEAR = 0.25
"""A link speaks if turning moves its middle nearer to its centre of mass, or away, by this share of its diagonal."""
_FEWEST, _TIMES = 3, 3
"""Links that must speak for turning, and how many times those that speak against it."""


def is_turned(robot: Robot, mesh_folder: Path | None = None) -> bool:
    """Whether a robot's COLLADA files with y up are to be turned to z up.

    Args:
        robot: The robot.
        mesh_folder: As of :func:`bodyimage_kin.robot.meshes.triangulate`.

    Returns:
        True where the middles of at least three links come clearly nearer to their centres of mass by it, three times
        as many as go away from them. Meshes that are missing say nothing.
    """
    return _judged(robot, robot.file, mesh_folder or robot.mesh_folder)


@functools.lru_cache(maxsize=32)
def _judged(robot: Robot, file: Path | None, folder: Path | None) -> bool:
    # Robots of the same text are equal wherever it lies, and their meshes need not be.
    pro = contra = 0
    for link, geometry in robot.geometry.items():
        elements: tuple[Collision | Visual, ...] = (*geometry.collisions, *geometry.visuals)
        shape = elements[0].shape if elements else None
        if not isinstance(shape, Mesh) or geometry.inertial is None or geometry.inertial.mass <= 0.0:
            continue
        try:
            if not names_y_up(mesh_path(shape, link, file, folder)):
                continue
            mesh = load_mesh(shape, link, file, folder).mesh
        except InvalidGeometry:
            continue
        rotation, position = elements[0].origin[:3, :3], elements[0].origin[:3, 3]
        middle, scale = mesh.bounds.mean(0), np.array(shape.scale)
        as_it_is, about = (
            float(np.linalg.norm(rotation @ one + position - geometry.inertial.xyz))
            for one in (middle, scale * (TURN[:3, :3] @ (middle / scale)))
        )
        nearer = (as_it_is - about) / float(np.linalg.norm(mesh.extents))
        pro, contra = pro + (nearer > _CLEAR), contra + (nearer < -_CLEAR)
    return pro >= _FEWEST and pro >= _TIMES * contra
