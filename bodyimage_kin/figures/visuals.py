"""The visuals of a URDF robot as triangles: primitives and meshes, placed by the robot's joints.

Nothing is fetched: a mesh is read from the folder of the URDF (or one that the caller names) or not at all.
"""

from __future__ import annotations

import io
import logging
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import trimesh
import yourdfpy
from jaxtyping import Float, Int

from bodyimage_kin.errors import InvalidGeometry, InvalidPosture, UnknownName
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.transforms import axis_angle_matrix, rpy_matrix, transform
from bodyimage_kin.robot.tree import Joint

PLAIN = (0.82, 0.80, 0.77, 1.0)
"""Colour (RGBA) of a visual that has none."""
MESH_SUFFIXES = frozenset({".stl", ".obj", ".dae", ".ply", ".off", ".glb"})
"""The mesh files that are read."""
RobotSource: TypeAlias = "Robot | str | bytes | os.PathLike[str]"
"""A robot, the path of a URDF, or the XML itself (beginning with ``<``)."""


class Surface(NamedTuple):
    """Triangles of a robot in its root's coordinates.

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
    urdf_source: RobotSource,
    posture: Mapping[str, Any],
    *,
    links: Iterable[str] | None = None,
    mesh_folder: str | os.PathLike[str] | None = None,
) -> Surface:
    """The visuals of a robot at a posture.

    Args:
        urdf_source: A robot, the path of a URDF, or the XML itself.
        posture: Joint values by name [rad or m]; the others are 0, mimic joints follow.
        links: The links to draw; None for all.
        mesh_folder: Where meshes may be read, subfolders included; default: the folder of the URDF file.

    Returns:
        The triangles in the root, coloured as the materials say.

    Raises:
        InvalidURDF: The robot cannot be read.
        UnknownName: A joint or link that the robot does not have.
        InvalidPosture: A joint value that is not finite.
        InvalidGeometry: A visual that cannot be read, or a mesh that is missing or outside ``mesh_folder``.
    """
    robot = urdf_source if isinstance(urdf_source, Robot) else Robot.from_urdf(_path_or_xml(urdf_source))
    wanted = set(robot.link_names if links is None else links)
    for name in sorted(wanted.difference(robot.link_names)):
        raise UnknownName("link", name, robot.link_names)
    poses = link_poses(robot, posture)
    home = robot.file and robot.file.parent
    folder = None if mesh_folder is None else Path(mesh_folder)
    corners, normals, colours = [np.empty((0, 3, 3))], [np.empty((0, 3, 3))], [np.empty((0, 4))]
    owners = [np.empty(0, dtype=np.int64)]
    with _quiet():
        parsed = _parsed(robot.source)
        visuals = [(link.name, visual) for link in parsed.links for visual in link.visuals]
        named = [*(visual.material for _, visual in visuals), *parsed.materials]
        materials = {material.name: material.color for material in named if material and material.color}
        for name, visual in visuals:
            if name not in wanted:
                continue
            mesh = _mesh(visual.geometry, name, home, folder)
            root_T_visual = poses[name] @ (visual.origin if visual.origin is not None else np.eye(4))
            corners.append(np.asarray(mesh.triangles) @ root_T_visual[:3, :3].T + root_T_visual[:3, 3])
            normals.append(_normals(visual.geometry, mesh) @ root_T_visual[:3, :3].T)
            colours.append(_colours(visual.material, materials, mesh))
            owners.append(np.full(len(mesh.faces), robot.link_names.index(name)))
    return Surface(
        np.concatenate(corners),
        np.concatenate(normals),
        np.concatenate(colours),
        np.concatenate(owners),
        robot.link_names,
    )


def link_poses(robot: Robot, posture: Mapping[str, Any]) -> dict[str, Float[np.ndarray, "4 4"]]:
    """``root_T_link`` of every link at a posture given by joint names (the others at 0), in plain numpy.

    Raises:
        UnknownName: A joint that the robot does not have, or that follows another.
        InvalidPosture: A value that is not finite.
    """
    for name, value in posture.items():
        if name not in robot.joint_names:
            raise UnknownName("joint", name, robot.joint_names)
        if not np.isfinite(value):
            raise InvalidPosture(f"joint {name!r} is at {value}; give a finite value")
    below: dict[str, list[Joint]] = {}
    for joint in robot.tree.joints:
        below.setdefault(joint.parent, []).append(joint)
    poses, open_links = {robot.root: np.eye(4)}, [robot.root]
    while open_links:
        parent = open_links.pop()
        for joint in below.get(parent, ()):
            poses[joint.child] = (
                poses[parent] @ transform(rpy_matrix(joint.rpy), joint.xyz) @ _motion(robot, joint, posture)
            )
            open_links.append(joint.child)
    return poses


def _motion(robot: Robot, joint: Joint, posture: Mapping[str, Any]) -> Float[np.ndarray, "4 4"]:
    if joint.kind == "fixed":
        return np.eye(4)
    source, multiplier, offset = robot.source_of(joint.name)
    value = multiplier * float(posture.get(source, 0.0)) + offset
    if joint.kind == "prismatic":
        return transform(np.eye(3), value * np.asarray(joint.axis))
    return transform(axis_angle_matrix(joint.axis, value), (0.0, 0.0, 0.0))


def _path_or_xml(source: str | bytes | os.PathLike[str]) -> str | bytes | Path:
    return source if isinstance(source, str | bytes) else Path(source)


@contextmanager
def _quiet() -> Iterator[None]:
    # yourdfpy logs its guesses, trimesh warns of others' meshes: neither concerns the reader of a figure.
    loggers = [logging.getLogger(name) for name in ("yourdfpy.urdf", "trimesh")]
    disabled = [logger.disabled for logger in loggers]
    try:
        for logger in loggers:
            logger.disabled = True
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, before in zip(loggers, disabled, strict=True):
            logger.disabled = before


def _parsed(data: bytes) -> Any:
    try:
        return yourdfpy.URDF.load(io.BytesIO(data), build_scene_graph=False, load_meshes=False).robot
    except Exception as problem:
        raise InvalidGeometry(
            f"the robot's geometry cannot be read: {problem!r}; mend its <visual> and <collision> elements"
        ) from problem


def _mesh(geometry: Any, link: str, home: Path | None, folder: Path | None) -> Any:
    if geometry is None:
        raise InvalidGeometry(f"link {link!r} has a visual without geometry; add a box, sphere, cylinder or mesh")
    if geometry.box is not None:
        return trimesh.creation.box(extents=geometry.box.size)
    if geometry.sphere is not None:
        return trimesh.creation.icosphere(
            subdivisions=4 if geometry.sphere.radius > 0.03 else 3, radius=geometry.sphere.radius
        )
    if geometry.cylinder is not None:
        cylinder = geometry.cylinder
        return trimesh.creation.cylinder(radius=cylinder.radius, height=cylinder.length, sections=64)
    path = _mesh_path(geometry.mesh.filename, link, home, folder)
    try:
        # From bytes and without a resolver: a mesh that refers to further files cannot make us read them.
        mesh: Any = trimesh.load(
            io.BytesIO(path.read_bytes()), file_type=path.suffix[1:].lower(), force="mesh", skip_materials=True
        )
        if not len(mesh.faces):
            raise ValueError("it has no triangles")
    except Exception as problem:
        raise InvalidGeometry(f"link {link!r}: mesh {path} cannot be read: {problem}; mend the file") from problem
    if geometry.mesh.scale is not None:
        mesh.apply_transform(np.diag([*np.broadcast_to(geometry.mesh.scale, 3), 1.0]))
    return mesh


def _normals(geometry: Any, mesh: Any) -> Float[np.ndarray, "triangles 3 3"]:
    corners = np.asarray(mesh.triangles)
    if geometry.sphere is not None:
        return corners / geometry.sphere.radius
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = np.repeat(flat[:, None], 3, axis=1) / np.linalg.norm(flat, axis=1).clip(1e-300)[:, None, None]
    if geometry.cylinder is not None:
        around = corners * [1, 1, 0] / geometry.cylinder.radius
        return np.where(np.abs(flat[..., 2:]) > 0.5, flat, around)
    return flat


def _mesh_path(name: str, link: str, home: Path | None, folder: Path | None) -> Path:
    allowed = folder or home
    if allowed is None:
        raise InvalidGeometry(f"link {link!r}: mesh {name!r} of a robot given as XML; say where in mesh_folder")
    package = re.fullmatch(r"package://([^/]+)/(.+)", name)
    if package:
        # A package is a folder of that name among the meshes, or the folder of meshes itself.
        candidates = [allowed / package[1] / package[2], allowed / package[2]]
    else:
        candidates = [(home or allowed) / name.removeprefix("file://"), allowed / name.removeprefix("file://")]
    inside = [path for path in map(Path.resolve, candidates) if path.is_relative_to(allowed.resolve())]
    if not inside:
        raise InvalidGeometry(f"link {link!r}: mesh {name!r} is outside {allowed}; widen mesh_folder if it is yours")
    if inside[0].suffix.lower() not in MESH_SUFFIXES:
        raise InvalidGeometry(f"link {link!r}: mesh {name!r} is none of {', '.join(sorted(MESH_SUFFIXES))}; convert it")
    for path in inside:
        if path.is_file():
            return path
    raise InvalidGeometry(f"link {link!r}: mesh {name!r} is not in {allowed}; set mesh_folder to where it is")


def _colours(material: Any, materials: Mapping[str, Any], mesh: Any) -> Float[np.ndarray, "triangles 4"]:
    colour = material and (material.color or materials.get(material.name))
    if colour:
        return np.tile(np.clip(colour.rgba, 0.0, 1.0), (len(mesh.faces), 1))
    if mesh.visual.kind in ("face", "vertex"):
        return np.asarray(mesh.visual.face_colors, dtype=np.float64) / 255
    return np.tile(PLAIN, (len(mesh.faces), 1))
