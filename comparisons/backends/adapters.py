"""Other libraries as their users get them, each behind the thinnest adapter that the conformance suite can ask.

An adapter names joints, hands over the posture and gives back what the library says. It mends nothing: a robot that the
library cannot read, joints that it forgets and digits that it loses are what the table is about.
"""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import bodyimage_kin as bk


class RawPytorchKinematics:
    """pytorch-kinematics as documented: parsed from the URDF, converted by ``.to(float64)``.

    It knows no followers; those stay at zero here.
    """

    offers = ("batch", "gradient")

    def __init__(self, urdf: str) -> None:
        import pytorch_kinematics
        import torch

        self._chain = pytorch_kinematics.build_chain_from_urdf(urdf.encode()).to(dtype=torch.float64)
        self._serial: dict[str, Any] = {}
        self.joint_names = bk.Robot.from_urdf(urdf).joint_names

    def pose_and_jacobian(self, q: Any, link: str) -> tuple[Any, Any]:
        """By one serial chain for each link."""
        import pytorch_kinematics
        import torch

        if link not in self._serial:
            self._serial[link] = pytorch_kinematics.SerialChain(self._chain, link, dtype=torch.float64)
        chain = self._serial[link]
        column = {name: index for index, name in enumerate(self.joint_names)}
        known = [name for name in chain.get_joint_parameter_names() if name in column]
        flat = q.reshape(q.shape[:-1].numel(), q.shape[-1])
        values = [
            flat[:, column[name]] if name in column else torch.zeros_like(flat[:, 0])
            for name in chain.get_joint_parameter_names()
        ]
        given = torch.stack(values, dim=-1) if values else flat.new_empty(len(flat), 0)
        packed, pose = chain.jacobian(given, ret_eef_pose=True)
        jacobian = flat.new_zeros(len(flat), 6, q.shape[-1])
        theirs = [index for index, name in enumerate(chain.get_joint_parameter_names()) if name in column]
        jacobian[:, :, [column[name] for name in known]] = packed[:, :, theirs]
        return pose.reshape(*q.shape[:-1], 4, 4), jacobian.reshape(*q.shape[:-1], 6, q.shape[-1])


class RawYourdfpy:
    """yourdfpy, which has poses only."""

    def __init__(self, urdf: str) -> None:
        import yourdfpy

        # Without meshes, so that only kinematics are read.
        self._model = yourdfpy.URDF.load(io.BytesIO(urdf.encode()), load_meshes=False)
        self._names = bk.Robot.from_urdf(urdf).joint_names

    def pose(self, q: np.ndarray, link: str) -> np.ndarray:
        """root_T_link."""
        self._model.update_cfg(dict(zip(self._names, q.tolist(), strict=True)))
        return np.asarray(self._model.get_transform(link))


class RawFrax:
    """frax (JAX): frames of moving joints, with Jacobians by JAX's forward derivative of them.

    It fuses links behind fixed joints, so of those it has no frame.
    """

    def __init__(self, urdf: str) -> None:
        import jax
        from frax.core.robot import Robot

        jax.config.update("jax_enable_x64", True)
        robot = bk.Robot.from_urdf(urdf)
        self.joint_names = robot.joint_names
        self._joint_above = {joint.child: joint.name for joint in robot.tree.joints if joint.kind != "fixed"}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "robot.urdf")
            path.write_text(urdf, encoding="utf-8")
            self._robot = Robot(str(path))
        self._column = {name: index for index, name in enumerate(self.joint_names)}
        self._derivative = jax.jit(jax.jacfwd(self._robot.joint_to_world_transforms))

    def pose_and_jacobian(self, q: np.ndarray, link: str) -> tuple[np.ndarray, np.ndarray]:
        """By the frame of the joint above the link."""
        order = [self._column.get(name) for name in self._robot.joint_names]
        values = np.array([0.0 if column is None else q[column] for column in order])
        frame = list(self._robot.joint_names).index(self._joint_above[link])
        pose = np.asarray(self._robot.joint_to_world_transforms(values))[frame]
        derivative = np.moveaxis(np.asarray(self._derivative(values))[frame], -1, 0)
        jacobian = np.zeros((6, len(q)))
        for column, rate in zip(order, derivative, strict=True):
            if column is not None:
                spin = rate[:3, :3] @ pose[:3, :3].T
                jacobian[:, column] = [*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
        return pose, jacobian


LIBRARIES = {
    "pytorch-kinematics": ("pytorch_kinematics", RawPytorchKinematics),
    "yourdfpy": ("yourdfpy", RawYourdfpy),
    "frax": ("frax", RawFrax),
}
"""Name of the package -> (module, adapter); one that is not installed is left out of the table."""
