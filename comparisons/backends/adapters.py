"""Other libraries as their users get them, each behind the thinnest adapter that the conformance suite can ask.

An adapter names joints, hands over the posture and gives back what the library says. It mends nothing: a robot that the
library cannot read, joints that it forgets and digits that it loses are what the table is about.
"""

from __future__ import annotations

import io
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

    It fuses links behind fixed joints, and expects of its users where those are in the frame before: given here. So is
    an inertia for each link, without which it reads no robot. It knows no followers; those stay at zero.
    """

    def __init__(self, urdf: str) -> None:
        from bench import frax_arm

        robot = bk.Robot.from_urdf(urdf)
        self.joint_names = robot.joint_names
        self._above = {joint.child: joint for joint in robot.tree.joints}
        self._truth = bk.kinematics(robot, "pinocchio")
        self._robot = frax_arm.load(frax_arm.with_inertia(urdf), "Robot") if robot.n else None

        import jax

        if self._robot is not None:
            self._order = [
                robot.joint_names.index(name) if name in robot.joint_names else None for name in self._robot.joint_names
            ]
            frames = self._robot.joint_to_world_transforms
            self._frames = jax.jit(lambda q: (frames(q), jax.jacfwd(frames)(q)))

    def pose_and_jacobian(self, q: np.ndarray, link: str) -> tuple[np.ndarray, np.ndarray]:
        """By the frame of the moving joint above the link."""
        import jax

        moving = link
        while moving in self._above and self._above[moving].kind == "fixed":
            moving = self._above[moving].parent
        home = np.zeros(len(q))
        offset = np.linalg.solve(self._truth.pose(home, moving).numpy(), self._truth.pose(home, link).numpy())
        jacobian = np.zeros((6, len(q)))
        if moving not in self._above:
            return offset, jacobian
        frame = list(self._robot.joint_names).index(self._above[moving].name)
        with jax.enable_x64(True):
            every, rates = self._frames(np.array([0.0 if column is None else q[column] for column in self._order]))
        pose = np.asarray(every)[frame] @ offset
        for column, rate in zip(self._order, np.moveaxis(np.asarray(rates)[frame], -1, 0) @ offset, strict=True):
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
