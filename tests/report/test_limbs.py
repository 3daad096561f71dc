"""What a robot is made of is read from its URDF: limits, lengths and masses, limb by limb."""

import math
from pathlib import Path

import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.report._limbs import limbs, link_masses

URDF = Path(__file__).parents[2] / "urdf" / "infant.urdf"
BRANCHED = """<robot name="r">
  <link name="base"><inertial><mass value="2"/></inertial></link>
  <link name="bar"><inertial><mass value="0.5"/></inertial></link>
  <link name="tray"><inertial><mass value="0.25"/></inertial></link>
  <link name="wheel"/><link name="left"/><link name="right"/><link name="nail"/>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="bar"/>
    <axis xyz="0 0 1"/><limit lower="-0.1" upper="0.25" effort="1" velocity="1"/></joint>
  <joint name="weld" type="fixed"><parent link="bar"/><child link="tray"/><origin xyz="0.3 0 0"/></joint>
  <joint name="spin" type="continuous"><parent link="tray"/><child link="wheel"/>
    <origin xyz="0 0.4 0"/><axis xyz="0 0 1"/></joint>
  <joint name="open" type="revolute"><parent link="wheel"/><child link="left"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="also" type="revolute"><parent link="wheel"/><child link="right"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="1" velocity="1"/><mimic joint="open"/></joint>
  <joint name="glue" type="fixed"><parent link="left"/><child link="nail"/><origin xyz="0 0 0.02"/></joint>
</robot>"""


def test_lengths_are_the_distances_between_joints():
    robot = bk.Robot.from_urdf(URDF)
    pose = bk.kinematics(robot, "pinocchio").pose
    place = {link: pose(torch.zeros(robot.n, dtype=torch.float64), link)[:3, 3] for link in robot.link_names}
    for limb in limbs(robot):
        for row, after in zip(limb.joints, limb.joints[1:], strict=False):
            distance = torch.linalg.vector_norm(place[after.joint.child] - place[row.joint.child])
            assert row.length == pytest.approx(float(distance), abs=1e-12)
    arm = next(limb for limb in limbs(robot) if limb.tip == "left_hand")
    assert arm.joints[-1].length == pytest.approx(
        float(torch.linalg.vector_norm(place["left_hand"] - place["left_palm"]))
    )


def test_limbs_branch_slide_spin_and_follow():
    trunk, left, right = limbs(bk.Robot.from_urdf(BRANCHED))
    assert [(limb.base, limb.tip, limb.degrees_of_freedom) for limb in (trunk, left, right)] == [
        ("base", "wheel", 2),
        ("wheel", "nail", 1),
        ("wheel", "right", 0),
    ]
    slide, spin = trunk.joints
    assert (slide.limits, slide.length, slide.mass) == ("\N{MINUS SIGN}100 to 250 mm", pytest.approx(0.5), 0.75)
    assert (spin.limits, spin.length, spin.mass) == ("unlimited", None, None)
    assert left.joints[0].length == pytest.approx(0.02)
    assert right.joints[0].limits == "follows open"


def test_limits_and_masses_are_the_robots_own():
    robot = bk.Robot.from_urdf(URDF)
    rows = {row.joint.name: row for limb in limbs(robot) for row in limb.joints}
    assert set(rows) == set(robot.joint_names)
    for index, name in enumerate(robot.joint_names):
        lower, upper = (f"{round(math.degrees(float(x[index])))}" for x in (robot.lower, robot.upper))
        assert rows[name].limits == f"{lower} to {upper}".replace("-", "\N{MINUS SIGN}")
    assert sum(limb.degrees_of_freedom for limb in limbs(robot)) == robot.n
    listed = sum(row.mass or 0 for row in rows.values())
    trunk = sum(link_masses(robot)[link] for link in ("pelvis", "torso"))
    assert listed + trunk == pytest.approx(sum(link_masses(robot).values()))
