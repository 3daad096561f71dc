"""Shapes as triangles.

Mesh files are read from the folder of the URDF or one that the caller names, those of ROS packages (``package://``)
also from a package that the URDF lies in, ``ROS_PACKAGE_PATH``, ``AMENT_PREFIX_PATH`` and installed wheels, and else
not at all. Nothing is fetched, and no mesh can make us read further files.
"""

from __future__ import annotations

import io
import os
import re
import sysconfig
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot.geometry import Box, Capsule, Cylinder, Mesh, Shape, Sphere

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "MESH_SUFFIXES",
    "TURN",
    "Loaded",
    "load_mesh",
    "mesh_path",
    "names_y_up",
    "package_file",
    "triangulate",
]

MESH_SUFFIXES = frozenset({".stl", ".obj", ".dae", ".ply", ".off", ".glb"})
"""The mesh files that are read."""
_PACKAGE = re.compile(r"package:/{2,3}([^/]+)/(.+)")
_SECTIONS = 64
"""Facets around a cylinder."""
_LARGEST = 5.0
"""A mesh larger than this [m] is taken to be in millimetres."""
TURN = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From coordinates in which y is up to those in which z is."""
_HEAD = 16384
"""So many bytes of a COLLADA file hold what it says of itself."""


class Loaded(NamedTuple):
    """A mesh file, read.

    Attributes:
        mesh: Its triangles, scaled [m].
        notes: What was mended.
    """

    mesh: trimesh.Trimesh
    notes: tuple[str, ...]


def triangulate(
    shape: Shape, link: str, file: Path | None = None, mesh_folder: Path | None = None, turned: bool = False
) -> trimesh.Trimesh:
    """A shape as a mesh, about its own origin [m].

    Args:
        shape: What to triangulate.
        link: Whose it is, for errors.
        file: The URDF's own; meshes may be read from its folder.
        mesh_folder: Where meshes may be read instead, subfolders included. Meshes of packages are looked for in
            ``ROS_PACKAGE_PATH``, ``AMENT_PREFIX_PATH`` and the shared files of installed wheels too.
        turned: Whether COLLADA files with y up are turned (:func:`bodyimage_kin.robot.upright.is_turned`).

    Raises:
        InvalidGeometry: A mesh that is missing, outside its folder, or cannot be read.
    """
    # Not at the top of the module: whoever draws nothing need not wait for it.
    import trimesh

    match shape:
        case Box(size):
            return trimesh.creation.box(extents=size)
        case Sphere(radius):
            return trimesh.creation.icosphere(subdivisions=4 if radius > 0.03 else 3, radius=radius)
        case Cylinder(radius, length):
            return trimesh.creation.cylinder(radius=radius, height=length, sections=_SECTIONS)
        case Capsule(radius, length):
            capsule = trimesh.creation.capsule(height=length, radius=radius, count=[_SECTIONS // 2, _SECTIONS])
            # One end of its cylinder stands at the origin.
            return capsule.apply_translation([0.0, 0.0, -capsule.bounds.mean(0)[2]])
    return load_mesh(shape, link, file, mesh_folder, turned).mesh


def load_mesh(
    mesh: Mesh, link: str, file: Path | None = None, mesh_folder: Path | None = None, turned: bool = False
) -> Loaded:
    """The triangles of a mesh file, and what was mended: one larger than 5 m is taken to be in millimetres.

    Args:
        mesh: Its name and scale.
        link: Whose it is, for errors.
        file: As of :func:`triangulate`.
        mesh_folder: As of :func:`triangulate`.
        turned: As of :func:`triangulate`.

    Raises:
        InvalidGeometry: As of :func:`triangulate`.
    """
    import trimesh

    path = mesh_path(mesh, link, file, mesh_folder)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # From bytes and without a resolver: a mesh that refers to further files cannot make us read them.
            loaded: Any = trimesh.load(
                io.BytesIO(path.read_bytes()), file_type=path.suffix[1:].lower(), force="mesh", skip_materials=True
            )
        if not len(loaded.faces):
            raise ValueError("it has no triangles")
    except Exception as problem:
        raise InvalidGeometry(f"link {link!r}: mesh {path} cannot be read: {problem}; mend the file") from problem
    notes: list[str] = []
    if turned and names_y_up(path):
        loaded.apply_transform(TURN)
        notes.append(
            f"mesh {mesh.filename} of link '{link}' has y up and is turned, as the centres of mass of its robot say"
        )
    loaded.apply_transform(np.diag([*mesh.scale, 1.0]))
    largest = float(loaded.extents.max())
    if largest > _LARGEST:
        loaded.apply_transform(np.diag([1e-3, 1e-3, 1e-3, 1.0]))
        scale = " ".join(f"{1e-3 * factor:g}" for factor in mesh.scale)
        notes.append(
            f"mesh {mesh.filename} of link '{link}' is {largest:.3g} m large: taken to be in millimetres; give it "
            f'scale="{scale}"'
        )
    return Loaded(loaded, tuple(notes))


def names_y_up(path: Path) -> bool:
    """Whether a file is of COLLADA and says that its y points up."""
    if path.suffix.lower() != ".dae":
        return False
    with path.open("rb") as file:
        return b"Y_UP" in file.read(_HEAD)


def package_file(name: str) -> Path:
    """Where a file of a ROS package is: by what the environment says, or among the shared files of installed wheels.

    Args:
        name: ``package://PACKAGE/path/in/it``.

    Raises:
        InvalidGeometry: No such name, package or file.
    """
    package = _PACKAGE.fullmatch(name)
    if package is None:
        raise InvalidGeometry(f"{name!r} names no file of a package; write package://PACKAGE/path")
    for place in _package_folders(package[1]):
        path = (place / package[2]).resolve()
        if path.is_file() and path.is_relative_to(place.resolve()):
            return path
    raise InvalidGeometry(
        f"{name!r} is in no package that is known; install what brings it (robots of the field: the extra "
        "bodyimage-kin[robots]), or set ROS_PACKAGE_PATH to where the package is"
    )


def mesh_path(mesh: Mesh, link: str, file: Path | None = None, mesh_folder: Path | None = None) -> Path:
    """Where a mesh's file is; see :func:`triangulate`."""
    return _find(mesh.filename, link, file and file.absolute().parent, mesh_folder)


def _find(name: str, link: str, home: Path | None, folder: Path | None) -> Path:
    """The file of a mesh. It may lie in a few places, and nowhere else: links and ``..`` lead out of none of them."""
    package = _PACKAGE.fullmatch(name)
    allowed = folder or home
    places: list[tuple[Path, str]] = []
    if allowed is not None and package:
        # A package is a folder of that name among the meshes, or the folder of meshes itself.
        places += [(allowed, f"{package[1]}/{package[2]}"), (allowed, package[2])]
    elif allowed is not None:
        plain = name.removeprefix("file://")
        places += [(allowed, str((home or allowed) / plain)), (allowed, plain)]
    if package:
        around = [] if home is None else [place for place in home.resolve().parents if place.name == package[1]]
        places += [(place, package[2]) for place in (*around, *_package_folders(package[1]))]
    if not places:
        raise InvalidGeometry(f"link {link!r}: mesh {name!r} of a robot given as XML; say where in mesh_folder")
    inside = [
        path for place, path_in in places if (path := (place / path_in).resolve()).is_relative_to(place.resolve())
    ]
    if not inside:
        limit = allowed or "its package"
        raise InvalidGeometry(f"link {link!r}: mesh {name!r} is outside {limit}; widen mesh_folder if it is yours")
    if inside[0].suffix.lower() not in MESH_SUFFIXES:
        raise InvalidGeometry(f"link {link!r}: mesh {name!r} is none of {', '.join(sorted(MESH_SUFFIXES))}; convert it")
    for path in inside:
        if path.is_file():
            return path
    where = f"in {allowed}" if allowed else "in any package"
    remedy = "set mesh_folder or ROS_PACKAGE_PATH" if package else "set mesh_folder"
    raise InvalidGeometry(f"link {link!r}: mesh {name!r} is not {where}; {remedy} to where it is")


def _package_folders(package: str) -> Iterator[Path]:
    """Where a ROS package may be: where the environment says, then among the shared files of installed wheels."""
    for entry in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        folder = Path(entry)
        yield folder if folder.name == package else folder / package
    for entry in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(entry) / "share" / package
    for prefix in (Path(sysconfig.get_path("data")), Path(sysconfig.get_path("purelib")) / "cmeel.prefix"):
        yield prefix / "share" / package
