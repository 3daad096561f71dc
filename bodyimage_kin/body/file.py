"""Embodiments as TOML files: read, checked as a whole, built; and written so that they are read back equal."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

from bodyimage_kin import _checks
from bodyimage_kin._files import atomic_path, write_text
from bodyimage_kin.backends import Kinematics
from bodyimage_kin.body._build import Mistakes, check_parts, put_together
from bodyimage_kin.body._camera_table import read_camera
from bodyimage_kin.body._skin_table import read_skin
from bodyimage_kin.body._tables import Table
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.hand import Hand
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.meshes import package_file

__all__ = ["embodiment_folder", "embodiments", "load_embodiment"]

_PACKAGE = Path(__file__).parents[1]


def embodiment_folder() -> Path:
    """Where the package's own robots are: inside an installed package, beside it in a checkout."""
    return next(folder for folder in (_PACKAGE / "urdf", _PACKAGE.parent / "urdf") if folder.is_dir())


def embodiments() -> tuple[str, ...]:
    """Names of the embodiments that come with the package."""
    return tuple(sorted(path.stem for path in embodiment_folder().glob("*.toml")))


def load_embodiment(
    name_or_path: str | Path,
    backend: str | Kinematics | type | None = None,
    *,
    mesh_folder: str | Path | None = None,
) -> Embodiment:
    """An embodiment by name, or from a TOML file.

    Its robot is a file beside it, or one of a package: ``urdf = "package://example-robot-data/robots/..."``.

    A camera model of one's own, ``model = "package.module:Class"``, is looked for in what is installed, beside the file
    and in the current folder; it is looked at before it is built of the table's other fields.

    Args:
        name_or_path: One of :func:`embodiments`, or the path of a TOML file.
        backend: As in :func:`bodyimage_kin.kinematics`.
        mesh_folder: Where the robot's meshes lie, subfolders included; None: what the file says, or beside the robot's.

    Raises:
        UnknownName: No such embodiment, or a joint, link or landmark that does not exist.
        InvalidConfig: A file that is no TOML, or a field that is missing, unknown or out of range; names the field.
        ManyMistakes: Several such things, all told at once.
        InvalidURDF: The robot it names cannot be trusted.
    """
    given: object = name_or_path
    if not isinstance(given, str | Path):
        raise InvalidConfig(f"an embodiment is loaded by its name or from a path, not from {type(given).__name__}")
    path = Path(name_or_path)
    if path.suffix != ".toml":
        if str(name_or_path) not in embodiments():
            raise UnknownName("embodiment", str(name_or_path), (*embodiments(), "a path ending in .toml"))
        path = embodiment_folder() / f"{name_or_path}.toml"
    try:
        values = tomllib.loads(path.read_bytes().decode())
    except OSError as problem:
        raise InvalidConfig(f"cannot read embodiment '{path}': {problem.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise InvalidConfig(f"embodiment '{path.name}' is no valid TOML: {problem}") from None
    return _read(values, path, backend, None if mesh_folder is None else Path(mesh_folder))


def save_embodiment(body: Embodiment, path: str | Path) -> Path:
    """Writes an embodiment as a TOML file that is read back equal; see :meth:`Embodiment.save`."""
    path = Path(path)
    if path.suffix != ".toml":
        raise InvalidConfig(f"'{path}' is no name of an embodiment's file; let it end in .toml")
    write_text(path, body.to_toml(_robot_beside(body.robot, path)))
    return path


def _robot_beside(robot: Robot, path: Path) -> str:
    """The robot's file as seen from an embodiment's; written beside it where there is none, or another one by now."""
    folder = path.parent.absolute()
    if robot.file is not None:
        file = robot.file.absolute()
        if file.is_file() and file.read_bytes() == robot.source:
            return file.relative_to(folder).as_posix() if file.is_relative_to(folder) else file.as_posix()
    beside = path.with_suffix(".urdf")
    with atomic_path(beside) as temporary:
        temporary.write_bytes(robot.source)
    return beside.name


def _read(
    values: dict[str, Any], path: Path, backend: str | Kinematics | type | None, mesh_folder: Path | None
) -> Embodiment:
    """All mistakes are gathered before any is told."""
    mistakes = Mistakes(path.name)
    table = Table(values, path.name, mistakes)
    name, urdf = table.text("name"), table.text("urdf", "the robot's file")
    meshes = table.take("mesh_folder", lambda field, value: path.parent / _checks.text(field, value), default=None)
    joints = table.take("joints", _names, wanted="a list of joint names")
    home, hand = table.table("home", default=None), table.table("hand")
    camera, skin = table.table("camera"), table.table("skin", default=None)
    table.close()
    the_hand: Any = None if hand is None else _read_hand(hand)
    the_camera: Any = None if camera is None else read_camera(camera, path.parent)
    the_skin = None if skin is None else read_skin(skin, path.parent)
    robot: Any = None
    felt: Any = None
    posture: Any = None
    if urdf is not None:
        with mistakes.noted():
            place = package_file(urdf) if urdf.startswith("package:") else path.parent / urdf
            robot = Robot.from_urdf(place, mesh_folder=mesh_folder or meshes)
    if robot is not None:
        links = {
            what: one.values["link"]
            for what, one in (("hand", hand), ("camera", camera), ("skin", skin))
            if one is not None and isinstance(one.values.get("link"), str)
        }
        named = None if home is None else home.values
        felt, posture = check_parts(mistakes, robot, joints, links, named, f"{path.name} ")
    mistakes.tell()
    places = [the_hand.link, the_camera.link, *([] if the_skin is None else [the_skin[0]])]
    kinematics = put_together(robot, felt, places, posture, backend)
    body = Embodiment(name, robot, felt, the_hand, the_camera, None, posture, kinematics)
    if the_skin is None:
        return body
    link, lay = the_skin
    return dataclasses.replace(body, skin=lay(robot, kinematics.pose(body.felt_home, link)))


def _read_hand(table: Table) -> Hand | None:
    link, offset = table.text("link"), table.numbers("offset", 3, default=(0.0, 0.0, 0.0))
    radius = table.number("radius", default=0.0, least=0.0)
    table.close()
    hand: Hand | None = table.make(lambda: Hand(link, offset, radius))
    return hand


def _names(field: str, value: Any) -> list[str]:
    if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
        _checks.refuse(field, value, "a list of joint names")
    return value
