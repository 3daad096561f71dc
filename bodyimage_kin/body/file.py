"""Embodiments as TOML files: read, checked field by field, and built."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin.backends import Kinematics, kinematics
from bodyimage_kin.body.cameras import Camera, VirtualScreen
from bodyimage_kin.body.embodiment import Embodiment, Hand
from bodyimage_kin.body.skin import Patch, Skin
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.robot import Robot, transforms
from bodyimage_kin.robot.shapes import collision_shapes

_PACKAGE = Path(__file__).parents[1]


def embodiment_folder() -> Path:
    """Where the package's own robots are: inside an installed package, beside it in a checkout."""
    return next(folder for folder in (_PACKAGE / "urdf", _PACKAGE.parent / "urdf") if folder.is_dir())


def embodiments() -> tuple[str, ...]:
    """Names of the embodiments that come with the package."""
    return tuple(sorted(path.stem for path in embodiment_folder().glob("*.toml")))


def load_embodiment(name_or_path: str | Path, backend: str | Kinematics | type | None = None) -> Embodiment:
    """An embodiment by name, or from a TOML file.

    Args:
        name_or_path: One of :func:`embodiments`, or the path of a TOML file.
        backend: As in :func:`bodyimage_kin.kinematics`.

    Raises:
        UnknownName: No such embodiment, or a joint, link or landmark that does not exist.
        InvalidConfig: A file that is no TOML, or a field that is missing, unknown or out of range; names the field.
        InvalidURDF: The robot it names cannot be trusted.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        if str(name_or_path) not in embodiments():
            raise UnknownName("embodiment", str(name_or_path), (*embodiments(), "a path ending in .toml"))
        path = embodiment_folder() / f"{name_or_path}.toml"
    try:
        source = path.read_bytes()
        table = tomllib.loads(source.decode())
    except OSError as problem:
        raise InvalidConfig(f"cannot read embodiment '{path}': {problem.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise InvalidConfig(f"embodiment '{path.name}' is no valid TOML: {problem}") from None
    return _build(_Table(table, path.name), path.parent, source, backend)


class _Table:
    """A TOML table whose every field is asked for by name and kind; what nobody asks for is an error."""

    def __init__(self, values: Mapping[str, Any], place: str) -> None:
        self.values, self.place, self.asked = values, place, set[str]()

    def take(self, field: str, kind: str, check: Callable[[Any], bool], default: Any = None) -> Any:
        self.asked.add(field)
        if field not in self.values:
            if default is None:
                raise InvalidConfig(f"{self.place}: field '{field}' is missing; give {kind}")
            return default
        value = self.values[field]
        if not check(value):
            raise InvalidConfig(f"{self.place}: field '{field}' is {value!r}; give {kind}")
        return value

    def text(self, field: str) -> str:
        return str(self.take(field, "a name", lambda value: isinstance(value, str) and bool(value)))

    def number(self, field: str, default: float | None = None, below: float = math.inf) -> float:
        kind = "a positive number" + (f" below {below:g}" if math.isfinite(below) else "")
        return float(self.take(field, kind, lambda value: _is_number(value) and 0 < value < below, default))

    def vector(self, field: str, length: int = 3, default: list[float] | None = None) -> Float[np.ndarray, "length"]:
        kind = f"{length} finite numbers"
        return np.array(self.take(field, kind, lambda v: _is_list(v, length, _is_number), default), dtype=float)

    def table(self, field: str) -> _Table:
        return _Table(self.take(field, "a table", lambda value: isinstance(value, dict)), f"{self.place} [{field}]")

    def refuse_unknown(self) -> None:
        for field in self.values:
            if field not in self.asked:
                unknown = UnknownName(f"field in {self.place}", field, sorted(self.asked))
                raise InvalidConfig(str(unknown))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_list(value: Any, length: int, check: Callable[[Any], bool]) -> bool:
    return isinstance(value, list) and len(value) == length and all(map(check, value))


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _build(table: _Table, folder: Path, source: bytes, backend: str | Kinematics | type | None) -> Embodiment:
    name = table.text("name")
    robot = Robot.from_urdf(folder / table.text("urdf"))
    felt = table.take(
        "joints", "a list of joint names", lambda v: isinstance(v, list) and bool(v) and len(set(map(str, v))) == len(v)
    )
    indices = sorted(robot.joint_index(joint) for joint in felt)
    joints = tuple(robot.joint_names[index] for index in indices)
    home = _home(table.table("home"), robot)
    hand = _hand(table.table("hand"), robot)
    camera = _camera(table.table("camera"), robot)
    skin_table = table.table("skin")
    link = robot.check_link(skin_table.text("link"))
    table.refuse_unknown()
    arm = robot.subtree([hand.link, camera.link, link], joints=joints, posture=home)
    felt_kinematics = kinematics(arm, backend)
    root_T_link = felt_kinematics.pose(home[indices], link)
    skin = _skin(skin_table, link, robot, root_T_link)
    return Embodiment(name, robot, joints, hand, camera, skin, home, felt_kinematics, source)


def _home(table: _Table, robot: Robot) -> torch.Tensor:
    values = {
        robot.joint_names[robot.joint_index(joint)]: table.take(joint, "a number", _is_number) for joint in table.values
    }
    home = robot.posture(values, base=torch.zeros(robot.n, dtype=torch.float64))
    for index, joint in enumerate(robot.joint_names):
        lower, upper = float(robot.lower[index]), float(robot.upper[index])
        if not lower <= float(home[index]) <= upper:
            raise InvalidConfig(
                f"{table.place}: joint '{joint}' is at {float(home[index]):g} at home, beyond its limits "
                f"{lower:g} to {upper:g}; give a value within"
            )
    return home


def _hand(table: _Table, robot: Robot) -> Hand:
    hand = Hand(
        link=robot.check_link(table.text("link")),
        offset=torch.from_numpy(table.vector("offset", default=[0.0, 0.0, 0.0])),
        radius=table.number("radius"),
    )
    table.refuse_unknown()
    return hand


def _camera(table: _Table, robot: Robot) -> Camera:
    forward, right = _axes(table)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    position = table.vector("position", default=[0.0, 0.0, 0.0])
    camera = Camera(
        link=robot.check_link(table.text("link")),
        link_T_camera=torch.from_numpy(transforms.transform(rotation, position)),
        model=_model(table),
    )
    table.refuse_unknown()
    return camera


def _model(table: _Table) -> VirtualScreen:
    kind = table.text("model")
    if kind != "virtual_screen":
        raise UnknownName(f"camera model in {table.place}", kind, ["virtual_screen"])
    return VirtualScreen(
        distance=table.number("distance"),
        near=table.number("near"),
        half_angle=math.radians(table.number("half_angle_degrees", below=90.0)),
    )


def _axes(table: _Table) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Unit vectors forward and right, which must be orthogonal."""
    forward, right = table.vector("forward"), table.vector("right")
    lengths = np.linalg.norm(forward), np.linalg.norm(right)
    if min(lengths) < 1e-9 or abs(forward @ right) > 1e-9 * lengths[0] * lengths[1]:
        raise InvalidConfig(f"{table.place}: 'forward' and 'right' must be orthogonal and not zero")
    return forward / lengths[0], right / lengths[1]


def _skin(table: _Table, link: str, robot: Robot, root_T_link: torch.Tensor) -> Skin:
    shape = table.take("shape", "[rows, columns], both positive", lambda v: _is_list(v, 2, _is_count) and min(v) > 0)
    forward, right = _axes(table)
    size = table.take("size", "[height, width], both positive", lambda v: _is_list(v, 2, _is_number) and min(v) > 0)
    patch = Patch((shape[0], shape[1]), (float(size[0]), float(size[1])), table.vector("centre"), forward, right)
    landmark_table = table.table("landmarks")
    landmarks = {}
    for landmark in landmark_table.values:
        row, column = landmark_table.take(
            landmark,
            f"[row, column] within {shape}",
            lambda v: _is_list(v, 2, _is_count) and v[0] < shape[0] and v[1] < shape[1],
        )
        landmarks[landmark] = row * shape[1] + column
    chosen = {}
    for field in ("reference", "eye"):
        if (landmark := table.text(field)) not in landmarks:
            raise UnknownName(f"landmark for '{field}' in {table.place}", landmark, landmarks)
        chosen[field] = landmarks[landmark]
    table.refuse_unknown()
    shapes = collision_shapes(robot, link)
    return Skin.lay(link, patch, shapes, root_T_link, landmarks, chosen["reference"], chosen["eye"])
