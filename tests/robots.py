"""Small robots as URDF text, each with something that libraries get wrong, and postures that shrink."""

import functools
from collections.abc import Callable

import torch
from hypothesis import strategies as st

import bodyimage_kin as bk

TRICKY = """
<robot name="tricky">
  <link name="world"/><link name="zulu"/><link name="slide"/><link name="universe"/><link name="knuckle"/>
  <link name="tip"/><link name="nail"/><link name="alpha"/><link name="gripper"/>
  <joint name="zulu" type="continuous">
    <parent link="world"/><child link="zulu"/><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/><axis xyz="1 2 -2"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="zulu"/><child link="slide"/><origin xyz="0 0.1 0" rpy="0 0 1.1"/><axis xyz="0 3 4"/>
    <limit lower="-0.2" upper="0.3" effort="1" velocity="1"/>
  </joint>
  <joint name="end" type="revolute">
    <parent link="knuckle"/><child link="tip"/><origin xyz="0.05 0 0" rpy="0 0.3 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/><mimic joint="middle" multiplier="-0.5" offset="0.2"/>
  </joint>
  <joint name="middle" type="revolute">
    <parent link="universe"/><child link="knuckle"/><origin xyz="0.06 0 0.01" rpy="0.2 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/><mimic joint="base" multiplier="0.8" offset="-0.1"/>
  </joint>
  <joint name="base" type="revolute">
    <parent link="slide"/><child link="universe"/><origin xyz="0.2 0 0"/>
    <limit lower="-1.5" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="nail" type="fixed"><parent link="tip"/><child link="nail"/><origin xyz="0 0 0.01" rpy="1 1 1"/></joint>
  <joint name="alpha" type="revolute">
    <parent link="world"/><child link="alpha"/><origin xyz="0 -0.2 0" rpy="0 1.5707963267948966 0.7"/>
    <axis xyz="0 0 -1"/><limit lower="0.25" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="jaw" type="prismatic">
    <parent link="alpha"/><child link="gripper"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="alpha" multiplier="0.1" offset="0.03"/>
  </joint>
</robot>"""
"""Joints out of alphabetical order, a joint and a link of one name, links that libraries reserve, a joint that
cannot be at zero, a chain of followers that stands before what it follows, a sliding follower of a turning joint."""

ARM = """
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="hand"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="wrist" type="fixed"><parent link="lower"/><child link="hand"/><origin xyz="0.2 0 0"/></joint>
</robot>"""
"""Two links in the plane, 0.3 m and 0.2 m: everything about it can be written down by hand."""

ONE_JOINT = """
<robot name="door">
  <link name="frame"/><link name="leaf"/>
  <joint name="hinge" type="revolute">
    <parent link="frame"/><child link="leaf"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="2" effort="1" velocity="1"/>
  </joint>
</robot>"""

STATUE = """
<robot name="statue">
  <link name="plinth"/><link name="head"/>
  <joint name="neck" type="fixed"><parent link="plinth"/><child link="head"/><origin xyz="0 0 1" rpy="0 0 0.5"/></joint>
</robot>"""


@functools.cache
def infant() -> bk.Robot:
    return bk.load_embodiment("infant").robot


@functools.cache
def tricky() -> bk.Robot:
    return bk.Robot.from_urdf(TRICKY)


@functools.cache
def kinematics(make: Callable[[], bk.Robot], backend: str) -> bk.RobotKinematics:
    """Kept, as building chains costs more than computing with them."""
    return bk.kinematics(make(), backend)


def joint_value(lower: float, upper: float) -> st.SearchStrategy[float]:
    """Within limits, [-7, 7] where there are none; shrinks to zero, or else to a limit."""
    lower, upper = max(lower, -7.0), min(upper, 7.0)
    special = dict.fromkeys((min(max(0.0, lower), upper), lower, upper))
    return st.sampled_from(list(special)) | st.floats(lower, upper)


def postures(robot: bk.Robot) -> st.SearchStrategy[torch.Tensor]:
    """One posture within the limits."""
    values = [
        joint_value(lower, upper) for lower, upper in zip(robot.lower.tolist(), robot.upper.tolist(), strict=True)
    ]
    return st.tuples(*values).map(lambda chosen: torch.tensor(chosen, dtype=torch.float64))


def central(function: Callable[[torch.Tensor], torch.Tensor], q: torch.Tensor, step: float = 2e-3) -> torch.Tensor:
    """Derivative by central differences of fourth order, one more axis at the end: q (n,) -> (*values, n)."""
    aside = torch.tensor([1.0, -1.0, 2.0, -2.0], dtype=q.dtype)[:, None, None] * torch.eye(len(q), dtype=q.dtype) * step
    ahead, behind, far_ahead, far_behind = function(q + aside)
    return ((8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * step)).movedim(0, -1)
