"""frax, robot kinematics in JAX, as its users call it: compiled for each batch size, in float64, on the processor."""

from __future__ import annotations

import os
import tempfile
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bodyimage_kin.backends import kinematics
from bodyimage_kin.robot import Robot

Outputs = tuple[Tensor, ...]


def load(urdf: str, kind: str = "Manipulator", **settings: Any) -> Any:
    """What frax makes of a URDF.

    JAX gets as many threads as torch is allowed when this is first called, and keeps them: their number cannot be
    changed within a process.

    Args:
        urdf: The text.
        kind: Name of frax's class.
        settings: Of its constructor.
    """
    with _environment("NPROC", str(torch.get_num_threads())), warnings.catch_warnings():
        # It advises settings of the environment when it is imported, older JAX among them.
        warnings.simplefilter("ignore")
        import frax

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.urdf")
        path.write_text(urdf, encoding="utf-8")
        return getattr(frax, kind)(str(path), **settings)


def with_inertia(urdf: str) -> str:
    """The same kinematics, with an inertia for each link: frax 0.1.0 reads none without (AttributeError)."""
    robot = ET.fromstring(urdf)
    for link in robot.iter("link"):
        if link.find("inertial") is None:
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "mass", value="1")
            ET.SubElement(inertial, "inertia", ixx="1", ixy="0", ixz="0", iyy="1", iyz="0", izz="1")
    return ET.tostring(robot, encoding="unicode")


def calls(robot: Robot, link: str) -> tuple[Callable[[Tensor], Outputs], Callable[[Tensor], Outputs]]:
    """Forward and backward of an :class:`~bench.engines.Engine`, by frax's Jacobian of an end effector.

    Float64 is switched on for these calls alone; tensors are handed over without copies.

    Args:
        robot: A serial arm without followers.
        link: Its end.
    """
    # Links behind fixed joints have no frame there: the last joint's, and the way from it to the link.
    above = next(joint.child for joint in robot.tree.joints if joint.name == robot.joint_names[-1])
    oracle, home = kinematics(robot, "pinocchio"), torch.zeros(robot.n, dtype=torch.float64)
    offset = np.linalg.solve(oracle.pose(home, above).numpy(), oracle.pose(home, link).numpy())
    urdf = with_inertia(robot.to_urdf())
    arm = load(urdf, joint_ordering=list(robot.joint_names), ee_offset=offset)

    import jax

    def one(q: Any) -> tuple[Any, Any]:
        jacobian, pose = arm.velocity_control_matrices(q)
        return pose, jacobian

    pose_and_jacobian = jax.vmap(one)

    def differentiated(q: Any, gradients: Any) -> tuple[Any, ...]:
        outputs, pull_back = jax.vjp(pose_and_jacobian, q)
        return *outputs, *pull_back(gradients)

    forward, both = jax.jit(pose_and_jacobian), jax.jit(differentiated)
    # Arguments, for as constants they would be worked into what is compiled.
    ones: dict[int, tuple[Any, Any]] = {}

    def call(q: Tensor, backward: bool) -> Outputs:
        with jax.enable_x64(True):
            given = jax.numpy.from_dlpack(q)
            if backward and len(q) not in ones:
                ones.clear()
                ones[len(q)] = jax.numpy.ones((len(q), 4, 4)), jax.numpy.ones((len(q), 6, robot.n))
            outputs = jax.block_until_ready(both(given, ones[len(q)]) if backward else forward(given))
            return tuple(torch.utils.dlpack.from_dlpack(output) for output in outputs)

    return partial(call, backward=False), partial(call, backward=True)


@contextmanager
def _environment(name: str, value: str) -> Iterator[None]:
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
