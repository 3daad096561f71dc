"""What is measured: every way to pose and Jacobian of an arm, behind one call."""

from __future__ import annotations

import importlib.util
import sysconfig
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from bench import frax_arm
from bodyimage_kin.backends import kinematics
from bodyimage_kin.backends.torch_backend import LinkChain
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.robot import Robot

Call = Callable[[Tensor], Any]


@dataclass(frozen=True)
class Arm:
    """An arm to measure.

    Attributes:
        name: What the tables call it.
        whole: The robot it is of.
        robot: The arm alone: its joints are those that move the link.
        link: Its end.
    """

    name: str
    whole: Robot
    robot: Robot
    link: str


@dataclass(frozen=True)
class Engine:
    """One way to compute pose and Jacobian.

    Attributes:
        name: What the tables call it.
        forward: Postures (batch, n) -> pose (batch, 4, 4) and Jacobian (batch, 6, n).
        backward: Postures -> the same, and the gradient of both; None where the library has none.
        threads: Whether more threads than one are used.
        fixed: Whether the number of threads cannot be changed within a process.
        most: Largest batch with a backward that ordinary memory holds.
    """

    name: str
    forward: Call
    backward: Call | None = None
    threads: bool = False
    fixed: bool = False
    most: int = 10_000_000


def arms() -> Iterator[Arm]:
    """The infant's arm, the Panda's and Talos's left one; the last two if ``example-robot-data`` is installed."""
    body = load_embodiment("infant")
    yield Arm("infant arm", body.robot, body.robot.subtree([body.hand.link], joints=body.joints), body.hand.link)
    robots = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
    for name, file, link, prefix in (
        ("Panda", "panda_description/urdf/panda.urdf", "panda_link8", "panda_joint"),
        ("Talos arm", "talos_data/robots/talos_full_v2.urdf", "gripper_left_base_link", "arm_left"),
    ):
        if (robots / file).is_file():
            whole = Robot.from_urdf(robots / file)
            joints = [joint for joint in whole.joint_names if joint.startswith(prefix)]
            yield Arm(name, whole, whole.subtree([link], joints=joints), link)


def missing() -> dict[str, str]:
    """What would be measured as well if it were installed."""
    wanted = {
        "example-robot-data": "pip install 'bodyimage-kin[bench]' (Panda and Talos)",
        "mujoco": "pip install mujoco",
        "frax": "pip install 'bodyimage-kin[bench]' (frax, on JAX)",
    }
    found = {"example-robot-data": len(list(arms())) > 1, **{name: _installed(name) for name in ("mujoco", "frax")}}
    return {name: how for name, how in wanted.items() if not found[name]}


def engines(arm: Arm) -> list[Engine]:
    """Every engine that is installed; the first is what the others are compared with."""
    ours, plain = kinematics(arm.robot, "numba"), kinematics(arm.robot, "torch")
    raw = _raw_pytorch_kinematics(arm)
    outputs: dict[int, tuple[Tensor, Tensor]] = {}

    def into(q: Tensor) -> tuple[Tensor, Tensor]:
        if len(q) not in outputs:
            outputs.clear()
            outputs[len(q)] = q.new_empty(len(q), 4, 4), q.new_empty(len(q), 6, q.shape[1])
        return ours.pose_and_jacobian(q, arm.link, out=outputs[len(q)])

    found = [
        Engine("pytorch-kinematics", raw, _differentiated(raw), threads=True, most=100_000),
        Engine(
            "numba",
            lambda q: ours.pose_and_jacobian(q, arm.link),
            _differentiated(lambda q: ours.pose_and_jacobian(q, arm.link)),
            threads=True,
        ),
        Engine("numba, out=", into, threads=True),
        Engine(
            "torch",
            lambda q: plain.pose_and_jacobian(q, arm.link),
            _differentiated(lambda q: plain.pose_and_jacobian(q, arm.link)),
            threads=True,
        ),
        Engine("numpy", _numpy(arm)),
    ]
    oracle = kinematics(arm.robot, "pinocchio")
    found.append(Engine("Pinocchio, arm alone", lambda q: oracle.pose_and_jacobian(q, arm.link)))
    found.append(Engine("Pinocchio, whole robot", _whole_pinocchio(arm)))
    if _installed("mujoco"):
        mujoco = kinematics(arm.robot, "mujoco")
        found.append(Engine("MuJoCo", lambda q: mujoco.pose_and_jacobian(q, arm.link)))
    if _installed("frax"):
        found.append(Engine("frax", *frax_arm.calls(arm.robot, arm.link), threads=True, fixed=True, most=100_000))
    return found


def _installed(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def _differentiated(forward: Call) -> Call:
    """Forward, and backward from fixed gradients of both outputs: every pose and Jacobian weighs one."""
    ones: dict[torch.Size, Tensor] = {}

    def both(q: Tensor) -> Any:
        q = q.detach().requires_grad_()
        outputs = forward(q)
        for output in outputs:
            if output.shape not in ones:
                ones[output.shape] = torch.ones_like(output)
        torch.autograd.backward(outputs, [ones[output.shape] for output in outputs])
        ones_kept = {output.shape for output in outputs}
        for shape in set(ones) - ones_kept:
            del ones[shape]
        return outputs[0].detach(), outputs[1].detach(), q.grad

    return both


def _raw_pytorch_kinematics(arm: Arm) -> Call:
    """The library as its users call it, float64 asked for; the URDF's numbers went through its float32."""
    import pytorch_kinematics

    chain = pytorch_kinematics.build_chain_from_urdf(arm.robot.to_urdf().encode()).to(dtype=torch.float64)
    serial = pytorch_kinematics.SerialChain(chain, arm.link, dtype=torch.float64)
    order = [arm.robot.joint_index(name) for name in serial.get_joint_parameter_names()]
    ordered = order == list(range(arm.robot.n))

    def forward(q: Tensor) -> tuple[Tensor, Tensor]:
        jacobian, pose = serial.jacobian_tensor(q if ordered else q[:, order], ret_eef_pose=True)
        return pose, jacobian if ordered else jacobian[:, :, np.argsort(order)]

    return forward


def _whole_pinocchio(arm: Arm) -> Call:
    """Pinocchio on the robot as it comes, of which the arm is a part; the other joints stay at zero."""
    import pinocchio

    whole = arm.whole.unfolded
    model = pinocchio.buildModelFromXML(whole.to_urdf())
    data = model.createData()
    frame = model.getFrameId(arm.link, pinocchio.BODY)
    joints = [model.joints[model.getJointId(name)] for name in arm.robot.joint_names]
    places, columns = [joint.idx_q for joint in joints], [joint.idx_v for joint in joints]

    def forward(q: Tensor) -> tuple[Tensor, Tensor]:
        pose, jacobian = np.empty((len(q), 4, 4)), np.empty((len(q), 6, len(columns)))
        configuration = pinocchio.neutral(model)
        for index, posture in enumerate(q.numpy()):
            configuration[places] = posture
            pinocchio.computeJointJacobians(model, data, configuration)
            pose[index] = pinocchio.updateFramePlacement(model, data, frame).homogeneous
            every = pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)
            jacobian[index] = every[:, columns]
        return torch.from_numpy(pose), torch.from_numpy(jacobian)

    return forward


def _numpy(arm: Arm) -> Call:
    """Structure of arrays in plain numpy."""
    chain = LinkChain.to(arm.robot, arm.link)
    steps, columns, sliding = chain.steps.numpy(), chain.columns.tolist(), chain.sliding

    def forward(q: Tensor) -> tuple[np.ndarray, np.ndarray]:
        values = np.ascontiguousarray(q.numpy().T)
        batch = values.shape[1]
        frame = [np.repeat(steps[0][:3, column, None], batch, 1) for column in range(4)]
        joints = []
        for column, slides, step in zip(columns, sliding, steps[1:], strict=True):
            x, y, z, origin = frame
            joints.append((column, slides, z, origin))
            if slides:
                origin = origin + values[column] * z
            else:
                sine, cosine = np.sin(values[column]), np.cos(values[column])
                x, y = cosine * x + sine * y, cosine * y - sine * x
            frame = [_mixed((x, y, z, origin), step[:, index]) for index in range(4)]
        pose = np.zeros((batch, 4, 4))
        pose[:, 3, 3] = 1.0
        for index in range(4):
            pose[:, :3, index] = frame[index].T
        jacobian = np.zeros((batch, 6, len(values)))
        for column, slides, axis, origin in joints:
            arm = frame[3] - origin
            if slides:
                jacobian[:, :3, column] = axis.T
                continue
            for row in range(3):
                a, b = (row + 1) % 3, (row + 2) % 3
                jacobian[:, row, column] = axis[a] * arm[b] - axis[b] * arm[a]
            jacobian[:, 3:, column] = axis.T
        return pose, jacobian

    return forward


def _mixed(parts: tuple[np.ndarray, ...], factors: Float[np.ndarray, "4"]) -> np.ndarray:
    """The sum of the parts times their factors; most factors of real robots are zero."""
    chosen = [factor * part for part, factor in zip(parts, factors.tolist(), strict=True) if factor != 0.0]
    return sum(chosen[1:], chosen[0])
