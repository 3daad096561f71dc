"""A small kinematics library with switchable defects: what the laws must find. It is right while BUG is empty."""

from __future__ import annotations

from math import cos, sin
from xml.etree import ElementTree

import numpy as np

BUG = ""
BUGS = (
    *("wrong axis default", "float32 offsets", "swapped columns", "LOCAL for aligned", "dropped mimic", "dead hessian"),
    *("raw axis", "alphabetical joints", "mimic of a mimic", "intrinsic rpy", "angles modulo 360 degrees"),
)


class Robot:
    def __init__(self, urdf: str) -> None:
        joints = [Joint(element) for element in ElementTree.fromstring(urdf).iter("joint")]
        self.by_name = {joint.name: joint for joint in joints}
        self.above = {joint.child: joint for joint in joints}
        self.free = [joint.name for joint in joints if joint.kind != "fixed" and joint.mimic is None]
        if BUG == "alphabetical joints":
            self.free.sort()

    def drive(self, joint: Joint) -> tuple[int, float, float]:
        """Index, multiplier and offset of what drives a joint."""
        multiplier, offset = 1.0, 0.0
        while joint.mimic is not None:
            source, factor, constant = joint.mimic
            if BUG == "mimic of a mimic" and multiplier != 1.0:
                factor = 1.0
            multiplier, offset = multiplier * factor, offset + multiplier * constant
            joint = self.by_name[source]
        return self.free.index(joint.name), multiplier, offset

    def path(self, link: str) -> list[Joint]:
        joints = []
        while link in self.above:
            joints.append(self.above[link])
            link = joints[-1].parent
        return joints[::-1]


class Joint:
    def __init__(self, element: ElementTree.Element) -> None:
        def numbers(tag: str, key: str, default: str) -> np.ndarray:
            part = element.find(tag)
            return np.array((default if part is None else part.get(key, default)).split(), dtype=float)

        self.name, self.kind = element.get("name"), element.get("type")
        self.parent, self.child = element.find("parent").get("link"), element.find("child").get("link")
        self.xyz, rpy = numbers("origin", "xyz", "0 0 0"), numbers("origin", "rpy", "0 0 0")
        if BUG == "float32 offsets":
            self.xyz = self.xyz.astype(np.float32).astype(float)
        x, y, z = (turn(axis, angle) for axis, angle in zip(np.eye(3), rpy, strict=True))
        self.rotation = x @ y @ z if BUG == "intrinsic rpy" else z @ y @ x
        self.axis = numbers("axis", "xyz", "0 0 1" if BUG == "wrong axis default" else "1 0 0")
        if BUG != "raw axis":
            self.axis /= np.linalg.norm(self.axis)
        mimic = element.find("mimic")
        self.mimic = mimic is not None and (
            mimic.get("joint"),
            float(mimic.get("multiplier", 1)),
            float(mimic.get("offset", 0)),
        )
        self.mimic = self.mimic or None


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    if BUG == "angles modulo 360 degrees":
        angle = angle % 6.2832
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + sin(angle) * cross + (1 - cos(angle)) * cross @ cross


def columns(robot: Robot, q: np.ndarray, link: str) -> tuple[np.ndarray, list[tuple]]:
    """The pose, and (index, multiplier, linear, angular) of each moving joint on the path, root first."""
    rotation, position, moving = np.eye(3), np.zeros(3), []
    for joint in robot.path(link):
        position = position + rotation @ joint.xyz
        rotation = rotation @ joint.rotation
        if joint.kind == "fixed":
            continue
        k, multiplier, offset = robot.drive(joint)
        value, axis = multiplier * q[k] + offset, rotation @ joint.axis
        if BUG == "dropped mimic" and joint.mimic is not None:
            value = multiplier = 0.0
        moving.append((k, multiplier, joint.kind, axis, position))
        if joint.kind == "prismatic":
            position = position + axis * value
        else:
            rotation = rotation @ turn(joint.axis, value)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    zero = np.zeros(3)
    return pose, [
        (k, gain, axis, zero) if kind == "prismatic" else (k, gain, np.cross(axis, position - at), axis)
        for k, gain, kind, axis, at in moving
    ]


def forward(robot: Robot, q: np.ndarray, link: str) -> np.ndarray:
    """The pose of a link in the root."""
    return columns(robot, q, link)[0]


def jacobian(robot: Robot, q: np.ndarray, link: str) -> np.ndarray:
    """The Jacobian in the root's axes at the link."""
    pose, moving = columns(robot, q, link)
    result = np.zeros((6, len(q)))
    for k, gain, linear, angular in moving:
        result[:, k] += gain * np.concatenate([linear, angular])
    if BUG == "swapped columns":
        result[:, :2] = result[:, 1::-1].copy()
    if BUG == "LOCAL for aligned":
        result = np.concatenate([pose[:3, :3].T @ result[:3], pose[:3, :3].T @ result[3:]])
    return result


def hessian(robot: Robot, q: np.ndarray, link: str) -> np.ndarray:
    """The derivative of the Jacobian."""
    result = np.zeros((6, len(q), len(q)))
    if BUG == "dead hessian":
        return result
    _, moving = columns(robot, q, link)
    for a, (i, gain_i, v_i, w_i) in enumerate(moving):
        for b, (k, gain_k, v_k, w_k) in enumerate(moving):
            result[:3, i, k] += gain_i * gain_k * (np.cross(w_k, v_i) if b <= a else np.cross(w_i, v_k))
            if b < a:
                result[3:, i, k] += gain_i * gain_k * np.cross(w_k, w_i)
    return result
