"""Robots from tables of Denavit and Hartenberg: every frame is the product of the rows' matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig


def screw(axis, angle, length):
    """Turn about and slide along one of the frame's axes."""
    c, s = math.cos(angle), math.sin(angle)
    if axis == "x":
        return np.array([[1, 0, 0, length], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, length], [0, 0, 0, 1.0]])


def frames(rows, convention, kinds, q):
    """root_T_frame of each row, by the textbooks' matrices."""
    values, here, found = iter(q), np.eye(4), []
    for (a, d, alpha, offset), kind in zip(rows, kinds, strict=True):
        value = 0.0 if kind == "fixed" else next(values)
        slides = kind == "prismatic"
        z = screw("z", offset + (0.0 if slides else value), d + (value if slides else 0.0))
        x = screw("x", alpha, a)
        here = here @ (z @ x if convention == "classic" else x @ z)
        found.append(here)
    return found


lengths = st.sampled_from([0.0, 0.1, -0.3]) | st.floats(-1, 1)
angles = st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi]) | st.floats(-4, 4)
rows = st.tuples(lengths, lengths, angles, angles, st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]))


@given(
    table=st.lists(rows, min_size=1, max_size=5),
    convention=st.sampled_from(["classic", "modified"]),
    seed=st.integers(0, 9),
)
@settings(max_examples=80, deadline=None)
def test_frames_are_products_of_the_rows(table, convention, seed):
    numbers, kinds = [row[:4] for row in table], [row[4] for row in table]
    robot = bk.Robot.from_dh(numbers, convention, kinds=kinds)
    assert robot.joint_names == tuple(f"joint{i + 1}" for i, kind in enumerate(kinds) if kind != "fixed")
    q = robot.sample((), seed=seed)
    kin = bk.kinematics(robot, "torch")
    for index, expected in enumerate(frames(numbers, convention, kinds, q.tolist()), start=1):
        np.testing.assert_allclose(kin.pose(q, f"link{index}").numpy(), expected, atol=1e-14)
    again = bk.Robot.from_urdf(robot.to_urdf(), strict=True)
    assert again == robot
    assert hash(again) == hash(robot)


def test_both_conventions_say_the_same_of_one_arm():
    # Modified rows hold a and alpha of the classic row before, and the end what is left over.
    classic = [(0.1, 0.2, math.pi / 2, 0.3), (0.4, 0.0, 0.0, -0.5), (0.0, 0.1, -math.pi / 2, 0.0)]
    shifted = [(0.0, 0.0), *[(a, alpha) for a, _, alpha, _ in classic]]
    modified = [(a, d, alpha, offset) for (a, alpha), (_, d, _, offset) in zip(shifted, classic, strict=False)]
    modified.append((shifted[-1][0], 0.0, shifted[-1][1], 0.0))
    one = bk.Robot.from_dh(classic)
    other = bk.Robot.from_dh(modified, "modified", kinds=["revolute"] * 3 + ["fixed"])
    q = one.sample(5)
    for of in ("pose", "jacobian"):
        np.testing.assert_allclose(
            getattr(bk.kinematics(one, "torch"), of)(q, "link3"),
            getattr(bk.kinematics(other, "torch"), of)(q, "link4"),
            atol=1e-14,
        )


def test_names_and_limits_are_those_given():
    robot = bk.Robot.from_dh(
        [(0, 1, 0, 0), [1, 0, 0, 0], (0, 0, 0, 0)], kinds=["revolute", "prismatic", "continuous"],
        joints=["turn", "slide", "spin"], links=["base", "post", "cart", "wheel"], limits=[(-1, 2), None, (5, 6)],
        name="crane",
    )  # fmt: skip
    assert (robot.name, robot.root, robot.joint_names) == ("crane", "base", ("turn", "slide", "spin"))
    assert robot.link_names == ("base", "turn_turned", "post", "slide_turned", "cart", "spin_turned", "wheel")
    assert robot.lower.tolist() == [-1.0, -math.inf, -math.inf]
    assert robot.upper.tolist() == [2.0, math.inf, math.inf]
    assert bk.Robot.from_dh(np.zeros((1, 4)), "modified").link_names == ("link0", "link1")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rows": [(0, 0, 0)]}, r"rows has shape \(1, 3\); give a, d, alpha and offset"),
        ({"rows": []}, "rows has shape"),
        ({"rows": [(0, 0, 0, math.nan)]}, r"rows\[0\]\[3\]=.*nan.*: give a number"),
        ({"rows": "0 0 0 0"}, "rows .* not numbers"),
        ({"convention": "craig"}, "convention='craig': give one of 'classic', 'modified'"),
        ({"kinds": ["hinge"]}, r"kinds\[0\]='hinge': give one of 'revolute'"),
        ({"kinds": ["revolute"] * 2}, "kinds=.* give 1 values, one a row"),
        ({"kinds": "revolute"}, "kinds='revolute': give 1 values"),
        ({"joints": ["a", "b"]}, "joints=.* give 1 names"),
        ({"joints": [""]}, r"joints\[0\]=''"),
        ({"links": ["a"]}, "links=.* give 2 names"),
        ({"links": ["a", "a"]}, "two of the names are the same"),
        ({"limits": [(1, 0)]}, r"limits\[0\]=\(1, 0\): give the lower limit first"),
        ({"limits": [1]}, r"limits\[0\]=1: give 2 numbers"),
        ({"name": ""}, "name=''"),
    ],
)
def test_what_makes_no_robot_is_refused(changes, message):
    with pytest.raises(InvalidConfig, match=message):
        bk.Robot.from_dh(**({"rows": [(0, 0, 0, 0)]} | changes))


@pytest.mark.real_data
@pytest.mark.parametrize(("side", "sign"), [("L", 1.0), ("R", -1.0)])
def test_the_table_of_a_nao_is_its_urdf_once_the_elbow_is_where_it_belongs(side, sign, real_data):
    # The published table turns the elbow's 15 mm with ElbowYaw, the URDF has them before it: a of the row before.
    half = math.pi / 2
    published = [
        (0, 0.1, -half, 0), (0, sign * 0.098, half, 0), (0, 0, half, half), (sign * 0.015, 0.105, -half, 0),
        (0, 0, half, 0), (0, 0.1137, -half, math.pi),
    ]  # fmt: skip
    moved = [*published[:2], (sign * 0.015, 0, half, half), (0, 0.105, -half, 0), *published[4:]]
    nao = bk.Robot.from_urdf(real_data / "nao" / "nao.urdf")
    q = nao.sample(100)
    kin = bk.kinematics(nao, "torch")
    torso_T_wrist = kin.pose(q, "torso").inverse() @ kin.pose(q, f"{side.lower()}_wrist")
    columns = [
        nao.joint_index(side + joint)
        for joint in ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
    ]
    apart = []
    for table in (published, moved):
        arm = bk.Robot.from_dh(table, kinds=["fixed"] + ["revolute"] * 5)
        end_T_wrist = bk.kinematics(arm, "torch").pose(q[:, columns], "link6").inverse() @ torso_T_wrist
        # The wrist's frame is not the table's last one, but fixed to it: the same at every posture.
        apart.append(float((end_T_wrist - end_T_wrist[0]).abs().max()))
    assert apart[0] > 0.01
    assert apart[1] < 1e-14
    # The hand's offset, of which the table makes one length with the forearm's 55.95 mm.
    assert end_T_wrist[0, :3, 3].norm() == pytest.approx(0.1137 - 0.05595)
