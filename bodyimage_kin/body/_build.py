"""Bodies put together: the parts are checked against the robot, and all that is wrong is told at once."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin._checks import number, refuse
from bodyimage_kin.backends import Kinematics, RobotKinematics, kinematics
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, ManyMistakes
from bodyimage_kin.robot import Robot

if TYPE_CHECKING:
    from bodyimage_kin.body.skin import Skin

Home = Mapping[str, float] | ArrayLike
Lay = Callable[[Robot, Float[Tensor, "4 4"]], "Skin"]
"""Lays a skin on its link, whose pose at home it is given."""


class Mistakes:
    """What is wrong with one thing, gathered, so that a user mends it all at once."""

    def __init__(self, place: str) -> None:
        self.place, self.found = place, list[BodyImageKinError]()

    @contextlib.contextmanager
    def noted(self) -> Iterator[None]:
        """Keeps the error of a block, which ends there."""
        try:
            yield
        except ManyMistakes as several:
            self.found.extend(several.mistakes)
        except BodyImageKinError as mistake:
            self.found.append(mistake)

    def tell(self) -> None:
        """Raises what was found: the error itself where there is one, else one that lists them.

        Raises:
            ManyMistakes: More than one.
        """
        if len(self.found) == 1:
            raise self.found[0]
        if self.found:
            raise ManyMistakes(self.place, self.found)


def check_parts(
    mistakes: Mistakes,
    robot: Robot,
    joints: Sequence[str] | None,
    links: Mapping[str, str],
    home: Home | None,
    place: str = "",
) -> tuple[tuple[str, ...], Float[Tensor, "n"]]:
    """The felt joints and the home posture, and whether all names are the robot's.

    Args:
        mistakes: What is wrong is noted there.
        robot: The whole robot.
        joints: The joints it feels, in order; None: wrong already.
        links: What is mounted (``"hand"``) -> the link that carries it.
        home: Joint values by name [rad or m], or a posture (n,); joints not named are at 0, or at the limit next to it.
        place: Before every message.

    Returns:
        Joints, and home; both mean nothing where something is wrong.
    """
    felt: tuple[str, ...] = ()
    posture = torch.zeros(robot.n, dtype=torch.float64)
    with mistakes.noted():
        felt = _check_joints(robot, joints, place)
    for link in links.values():
        with mistakes.noted():
            robot.check_link(link)
    with mistakes.noted():
        posture = _check_home(robot, home, place)
    return felt, posture


def put_together(
    robot: Robot,
    joints: Sequence[str],
    links: Sequence[str],
    home: Float[Tensor, "n"],
    backend: str | Kinematics | type | None,
) -> RobotKinematics:
    """The kinematics of the smaller robot that moves these links by the felt joints alone, in their order.

    Args:
        robot: The whole robot.
        joints: The felt joints.
        links: Links to keep.
        home: Where all others are welded.
        backend: As in :func:`bodyimage_kin.kinematics`.
    """
    return kinematics(robot.subtree(links, joints=joints, posture=home).reordered(joints), backend)


def _check_joints(robot: Robot, joints: Sequence[str] | None, place: str) -> tuple[str, ...]:
    given = [] if joints is None else joints
    if isinstance(given, str) or not all(isinstance(name, str) for name in given) or (joints is not None and not given):
        refuse(f"{place}joints", joints, "a list of names of joints")
    several = Mistakes(f"{place}joints")
    kinds = {joint.name: joint for joint in robot.tree.joints}
    for index, name in enumerate(given):
        with several.noted():
            joint = kinds.get(name)
            if joint is not None and joint.kind == "fixed":
                raise InvalidConfig(f"{place}joints: '{name}' is fixed and cannot be felt; name joints that move")
            if joint is not None and joint.mimic is not None:
                raise InvalidConfig(
                    f"{place}joints: '{name}' follows '{robot.source_of(name)[0]}' and is moved by it; name that one"
                )
            robot.joint_index(name)
            if name in given[:index]:
                raise InvalidConfig(f"{place}joints: '{name}' stands twice; name each once")
    several.tell()
    return tuple(given)


def _check_home(robot: Robot, home: Home | None, place: str) -> Float[Tensor, "n"]:
    several = Mistakes(f"{place}home")
    if home is None or isinstance(home, Mapping):
        zero = torch.zeros(robot.n, dtype=torch.float64)
        posture = torch.minimum(torch.maximum(zero, robot.lower), robot.upper)
        for name, value in (home or {}).items():
            with several.noted():
                posture[robot.joint_index(name)] = number(f"{place}home: {name}", value)
    else:
        posture = robot.posture({}, base=home)
    for index, joint in enumerate(robot.joint_names):
        value, lower, upper = (float(numbers[index]) for numbers in (posture, robot.lower, robot.upper))
        if not lower <= value <= upper:
            with several.noted():
                raise InvalidConfig(
                    f"{place}home: joint '{joint}' is at {value:g}, beyond its limits {lower:g} to {upper:g}; give a "
                    "value within"
                )
    several.tell()
    return posture
