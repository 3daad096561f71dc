"""Which links and joints of an unknown robot the paper's experiment can use: eye, skin, arm, and where ahead is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.backends import kinematics
from bodyimage_kin.body.collisions import vertices_of
from bodyimage_kin.errors import InvalidConfig, InvalidGeometry
from bodyimage_kin.robot import Robot

__all__ = ["ahead_of", "axes_of", "eye_link", "felt_joints", "skin_link"]

_DRAWN = 2000
_FACE = 0.07
"""A link is as large as a face if two of its sides are at least this [m]."""
_EYES = ("right_eye", "righteye", "r_eye", "eye_right", "eye", "camera", "_cam", "head", "skull", "face")
_ARMS = ("hand", "wrist", "arm", "grip", "finger")
"""Parts of names of links that carry other cameras."""


def eye_link(robot: Robot, hand: str, camera: str | None, folder: Path | None, said: list[str]) -> str:
    """The link that carries the eye: the one that is named, or one whose name speaks of an eye, a camera or a head.

    Raises:
        UnknownName: No such link.
        InvalidConfig: None named, and no such name.
    """
    if camera is not None:
        return robot.check_link(camera)
    for part in _EYES:
        named = [
            link for link in robot.link_names if part in link.lower() and not any(one in link.lower() for one in _ARMS)
        ]
        if named:
            # Of several the outermost one with a shape: necks and mounts are named after heads too.
            link = max(named, key=lambda one: (_has_shape(robot, one), len(robot.path(one))))
            said.append(f"eye: on link '{link}', by its name; name another with --camera")
            return link
    palm = _body_of(robot, hand)
    large = [
        link for link in robot.link_names if _body_of(robot, link) != palm and _width(robot, link, folder, []) >= _FACE
    ]
    touched = (
        f"as skin one with a shape as large as a face: {', '.join(map(repr, large[:5]))}"
        if large
        else "give the link that is to be touched a <collision>, for none has a shape as large as a face"
    )
    raise InvalidConfig(
        f"no link of robot '{robot.name}' is named after an eye, a camera or a head; name one as camera, and "
        f"{touched}; its links are {', '.join(robot.link_names[:12])}{' ...' if len(robot.link_names) > 12 else ''}"
    )


def skin_link(robot: Robot, eye: str, skin: str | None, folder: Path | None, said: list[str]) -> str:
    """The link that bears the skin: the one that is named, or the nearest to the eye that is as large as a face.

    Raises:
        UnknownName: No such link.
        InvalidGeometry: None named, and none that large, or the meshes of those are missing.
    """
    if skin is not None:
        return robot.check_link(skin)
    problems: list[str] = []
    for link in (eye, *(joint.parent for joint in reversed(robot.path(eye)))):
        # What is welded to a link is part of it: heads carry shells and screens that are links of their own.
        welded = sorted(_welded_to(robot, link), key=lambda one: -_width(robot, one, folder, problems))
        for one in (link, *welded[:1]):
            if _width(robot, one, folder, problems) >= _FACE:
                said.append(f"skin: on link '{one}', the nearest to the eye that is as large as a face")
                return one
    raise InvalidGeometry(
        problems[0]
        if problems
        else f"neither link '{eye}' nor any above it, nor what is fixed to these, has a shape as large as a face "
        f"({1e3 * _FACE:.0f} mm); name one as skin"
    )


def felt_joints(robot: Robot, hand: str, face: str, said: list[str]) -> tuple[str, ...]:
    """Joints from the nearest common ancestor of hand and skin to the hand.

    Raises:
        InvalidConfig: There are none.
    """
    shared = {joint.name for joint in robot.path(face)}
    branch = [joint for joint in robot.path(hand) if joint.name not in shared]
    felt = tuple(dict.fromkeys(robot.source_of(joint.name)[0] for joint in branch if joint.kind != "fixed"))
    if not felt:
        raise InvalidConfig(f"no joint moves link '{hand}' against link '{face}'; name another hand")
    said.append(f"joints: the {len(felt)} from link '{branch[0].parent}', which hand and skin share, to the hand")
    return felt


def ahead_of(robot: Robot, hand: str, joints: tuple[str, ...], said: list[str]) -> Float[np.ndarray, "3"]:
    """Where a robot looks if it looks to where its hand moves most: along x of its root, or against it."""
    moving = robot.subtree([hand], joints=joints)
    poses = kinematics(moving).pose(moving.sample(_DRAWN, seed=0), hand)[:, :3, 3].numpy()
    shoulder = next(joint for joint in moving.path(hand) if joint.kind != "fixed").child
    at = kinematics(moving).pose(torch.zeros(moving.n, dtype=torch.float64), shoulder)[:3, 3].numpy()
    ahead = np.array([1.0 if poses[:, 0].mean() >= at[0] else -1.0, 0.0, 0.0])
    said.append(f"forward: {'' if ahead[0] > 0 else '-'}x of the root, to where the hand moves most")
    return ahead


def axes_of(forward: ArrayLike) -> Float[np.ndarray, "3 3"]:
    """Columns right, down, forward of a robot that stands upright, in its root.

    Raises:
        InvalidConfig: A direction that is vertical, or none.
    """
    up = np.array([0.0, 0.0, 1.0])
    ahead = as_float_array(forward, "forward", shapes=((3,),), error=InvalidConfig)
    ahead = ahead - (ahead @ up) * up
    if not np.linalg.norm(ahead) > 1e-9:
        raise InvalidConfig("forward: give a direction that is not vertical")
    ahead = ahead / np.linalg.norm(ahead)
    return np.stack([np.cross(ahead, up), -up, ahead], axis=1)


def _body_of(robot: Robot, link: str) -> str:
    """The last joint that moves a link, which names the rigid body that it is part of; "" of the root's."""
    return next((joint.name for joint in reversed(robot.path(link)) if joint.kind != "fixed"), "")


def _has_shape(robot: Robot, link: str) -> bool:
    return bool(robot.geometry[link].collisions or robot.geometry[link].visuals)


def _width(robot: Robot, link: str, folder: Path | None, problems: list[str]) -> float:
    """The second longest side of what stands for a link [m]; 0 of nothing."""
    parts = vertices_of(robot, link, folder, problems)
    return float(np.sort(np.ptp(np.concatenate(parts), axis=0))[1]) if parts else 0.0


def _welded_to(robot: Robot, link: str) -> Iterator[str]:
    """Links that only fixed joints hold on a link."""
    for joint in robot.tree.joints:
        if joint.parent == link and joint.kind == "fixed":
            yield joint.child
            yield from _welded_to(robot, joint.child)
