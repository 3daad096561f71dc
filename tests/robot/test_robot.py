"""Laws of robots: names, order, limits, sampling, subtrees."""

import dataclasses
import hashlib
import math
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import ARM, ONE_JOINT, STATUE, TRICKY, infant, postures, tricky

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidURDF, UnknownName
from bodyimage_kin.robot import transforms


def test_a_path_a_string_and_bytes_give_the_same_robot(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(ARM)
    robots = [bk.Robot.from_urdf(source) for source in (file, str(file), ARM, ARM.encode(), "\ufeff" + ARM.lstrip())]
    assert all(robot.tree == robots[0].tree for robot in robots)
    assert robots[0].file == robots[1].file == file
    assert robots[2].file is None
    assert robots[0].sha256 == robots[3].sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("no/such/file.urdf", "cannot read .*"),
        (b"no/such/file.urdf", "cannot read .*"),
        ("", "the text is empty"),
        ("bad\0path", "neither XML nor a path"),
        (".", "cannot read .*"),
    ],
)
def test_a_file_that_cannot_be_read_says_what_to_give(source, said):
    with pytest.raises(InvalidURDF, match=rf"{said}; give a path, or text beginning with '<'"):
        bk.Robot.from_urdf(source)


def test_names_and_joints_stand_in_the_order_of_the_file():
    robot = tricky()
    assert (robot.name, robot.root, robot.n) == ("tricky", "world", 4)
    assert robot.joint_names == ("zulu", "slide", "base", "alpha")
    assert robot.link_names == ("world", "zulu", "slide", "universe", "knuckle", "tip", "nail", "alpha", "gripper")
    assert [robot.joint_index(name) for name in robot.joint_names] == [0, 1, 2, 3]
    torch.testing.assert_close(robot.lower, torch.tensor([-math.inf, -0.2, -1.5, 0.25], dtype=torch.float64))
    torch.testing.assert_close(robot.upper, torch.tensor([math.inf, 0.3, 1.0, 1.0], dtype=torch.float64))
    assert repr(robot) == "Robot('tricky', 9 links, 4 joints)"


def test_a_notebook_shows_the_joints_and_the_notes():
    page = bk.Robot.from_urdf(
        ARM.replace('name="arm"', 'name="&lt;arm&gt;"').replace("</robot>", "<gazebo/></robot>")
    )._repr_html_()
    assert "<b>&lt;arm&gt;</b>: 4 links from <code>base</code>" in page
    assert page.count("<tr>") == 3
    assert "<td>1</td><td>elbow</td><td>revolute</td><td>upper</td><td>lower</td><td>-3</td><td>3</td>" in page
    assert page.endswith("<ul><li>line 12: passed over &lt;gazebo&gt; in &lt;robot&gt;</li></ul>")
    assert "<ul>" not in bk.Robot.from_urdf(STATUE)._repr_html_()


def test_robots_of_the_same_text_are_equal_in_other_processes_too(tmp_path):
    file = tmp_path / "tricky.urdf"
    file.write_text(TRICKY)
    robots = [
        bk.Robot.from_urdf(TRICKY),
        bk.Robot.from_urdf(file),
        tricky().subtree(["tip"]),
        bk.Robot.from_dh([[1, 2, 3, 4]]),
    ]
    assert robots[0] == robots[1] == tricky()
    assert len({*robots, tricky()}) == 3
    assert robots[0] != robots[2]
    assert robots[0] != "tricky"
    # Limits are kept by robots and their hashes too.
    assert all(robot.lower.shape == (robot.n,) for robot in robots)
    for robot in robots:
        (tmp_path / "robot").write_bytes(pickle.dumps(robot))
        program = (
            "import pickle, sys; robot = pickle.load(open(sys.argv[1], 'rb')); hash(robot); robot.unfolded; "
            "open(sys.argv[1], 'wb').write(pickle.dumps((robot, hash(robot))))"
        )
        environment = os.environ | {"PYTHONHASHSEED": "7"}
        subprocess.run(
            [sys.executable, "-c", program, str(tmp_path / "robot")], check=True, env=environment, timeout=100
        )
        again, hashed = pickle.loads((tmp_path / "robot").read_bytes())
        assert again == robot
        assert hashed == hash(again) == hash(robot)
        assert (again.notes, again.file, again.geometry) == (robot.notes, robot.file, robot.geometry)


def test_a_robot_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        tricky().source = b""


@pytest.mark.parametrize("make", [infant, tricky, lambda: bk.Robot.from_urdf(STATUE)])
def test_the_written_core_reads_back_as_the_same_robot(make):
    robot = make()
    again = bk.Robot.from_urdf(robot.to_urdf())
    assert again.tree == robot.tree
    assert again.to_urdf() == robot.to_urdf()


@pytest.mark.parametrize("batch", [(), 5, (0,), (2, 0, 3), (2, 3)])
@pytest.mark.parametrize("urdf", [TRICKY, STATUE])
def test_samples_are_within_limits_and_the_same_for_the_same_seed(urdf, batch):
    robot = bk.Robot.from_urdf(urdf)
    q = robot.sample(batch, seed=3)
    assert q.shape == ((batch,) if isinstance(batch, int) else batch) + (robot.n,)
    assert q.dtype == torch.float64
    assert (q >= robot.lower.clamp(min=-math.pi)).all()
    assert (q <= robot.upper.clamp(max=math.pi)).all()
    assert torch.equal(q, robot.sample(batch, seed=3))


def test_samples_are_finite_whatever_the_limits():
    largest = sys.float_info.max
    limits = [
        (-1e308, 1e308),
        (0.0, 1.7e308),
        None,
        (-3.0, -3.0),
        (-largest, 5.0),
        (-5.0, largest),
        (-largest, largest),
    ]
    robot = bk.Robot.from_dh(np.zeros((7, 4)), kinds=["prismatic", "revolute"] * 3 + ["prismatic"], limits=limits)
    robot = bk.Robot.from_urdf(robot.to_urdf())
    q = robot.sample((50,), seed=1)
    assert torch.isfinite(q).all()
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()
    assert float(q[:, 0].max()) > 5e307 > -5e307 > float(q[:, 0].min())
    # Within a turn of the one limit there is, or within half a turn of zero.
    assert (q[:, 4] > 5.0 - 2 * math.pi).all()
    assert (q[:, 5] < -5.0 + 2 * math.pi).all()
    assert (q[:, [2, 6]].abs() <= math.pi).all()


@pytest.mark.parametrize(("batch", "seed"), [(-1, 0), (True, 0), ((2, -1), 0), (2, -1)])
def test_a_bad_sample_is_refused(batch, seed):
    with pytest.raises(InvalidConfig, match=r"(batch|seed)=.*: give a whole number of at least 0"):
        tricky().sample(batch, seed=seed)


def test_samples_are_uniform_and_differ_between_seeds():
    robot = tricky()
    q = robot.sample(20_000, seed=0)
    lower, upper = robot.lower.clamp(min=-math.pi), robot.upper.clamp(max=math.pi)
    share = (q - lower) / (upper - lower)
    torch.testing.assert_close(share.mean(0), torch.full((4,), 0.5, dtype=torch.float64), atol=0.01, rtol=0)
    torch.testing.assert_close(share.var(0), torch.full((4,), 1 / 12, dtype=torch.float64), atol=0.003, rtol=0)
    assert not torch.equal(q, robot.sample(20_000, seed=1))


def test_a_posture_by_name_and_back():
    robot = tricky()
    values = {"alpha": 0.5, "zulu": 4.0, "base": -1.0, "slide": 0.1}
    q = robot.posture(values)
    assert q.tolist() == [4.0, 0.1, -1.0, 0.5]
    assert robot.named(q) == values
    base = np.array([1.0, 2.0, 3.0, 4.0], dtype=np.float32)
    assert robot.posture({"slide": 9.0}, base=base).tolist() == [1.0, 9.0, 3.0, 4.0]
    assert base.tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("values", "base", "error", "message"),
    [
        ({"zulu": 1.0}, None, InvalidPosture, "no value for slide, base, alpha; name every joint or give a base"),
        ({"bse": 1.0}, [0.0] * 4, UnknownName, "no joint 'bse'; did you mean 'base'"),
        ({"middle": 1.0}, [0.0] * 4, UnknownName, "no joint 'middle'"),
        ({"base": math.nan}, [0.0] * 4, InvalidPosture, "NaN or infinite"),
        ({"base": 1.0}, [0.0] * 3, InvalidPosture, "base posture has shape"),
        ({"base": 1.0}, [[0.0] * 4], InvalidPosture, "must be one posture"),
    ],
)
def test_a_bad_posture_by_name_says_which_joint(values, base, error, message):
    with pytest.raises(error, match=message):
        tricky().posture(values, base=base)


@pytest.mark.parametrize("q", [[0.0] * 3, [[0.0] * 4], 1.0])
def test_named_reads_one_posture(q):
    with pytest.raises(InvalidPosture):
        tricky().named(q)


@pytest.mark.parametrize("name", ["tipp", "zul", "", "Tip", "Zulu"])
def test_unknown_names_list_what_looks_like_them(name):
    robot = tricky()
    for look_up in (robot.path, robot.check_link, lambda n: robot.subtree([n])):
        with pytest.raises(UnknownName) as caught:
            look_up(name)
        assert caught.value.valid == robot.link_names
    with pytest.raises(UnknownName):
        robot.joint_index(name)
    with pytest.raises(UnknownName):
        robot.subtree(["tip"], joints=[name])


def test_a_path_leads_from_the_root_to_the_link():
    robot = tricky()
    assert [joint.name for joint in robot.path("nail")] == ["zulu", "slide", "base", "middle", "end", "nail"]
    assert robot.path("world") == ()


def test_followers_of_followers_are_resolved():
    robot = tricky()
    assert robot.source_of("base") == ("base", 1.0, 0.0)
    source, multiplier, offset = robot.source_of("end")
    # end = -0.5 middle + 0.2 and middle = 0.8 base - 0.1.
    assert source == "base"
    assert (multiplier, offset) == pytest.approx((-0.4, 0.25))
    matrix, constant = robot.folding
    assert robot.unfolded.joint_names == ("zulu", "slide", "end", "middle", "base", "alpha", "jaw")
    q = robot.posture({"zulu": 1.0, "slide": 0.1, "base": 0.5, "alpha": 0.3})
    expected = [1.0, 0.1, -0.4 * 0.5 + 0.25, 0.8 * 0.5 - 0.1, 0.5, 0.3, 0.1 * 0.3 + 0.03]
    assert (matrix @ q + constant).tolist() == pytest.approx(expected)
    arm = bk.Robot.from_urdf(ARM)
    assert arm.unfolded is arm


def test_a_subtree_keeps_what_moves_its_links():
    robot = tricky()
    assert robot.subtree(["gripper"]).link_names == ("world", "alpha", "gripper")
    assert robot.subtree(["tip"]).joint_names == ("zulu", "slide", "base")
    # A joint off the way to the link is kept when it is asked for.
    assert robot.subtree(["slide"], joints=["alpha", "zulu"]).joint_names == ("zulu", "alpha")
    assert robot.subtree(["world"]).n == 0
    assert robot.tree == tricky().tree


def test_a_subtree_is_a_robot_of_its_own():
    part = tricky().subtree(["tip"])
    assert part.sha256 != tricky().sha256
    assert bk.Robot.from_urdf(part.source).tree == part.tree


@pytest.mark.parametrize("make", [tricky, infant])
@given(data=st.data())
@settings(max_examples=25)
def test_a_subtree_moves_as_the_whole_robot_does(make, data):
    robot = make()
    q = data.draw(postures(robot), label="q")
    link = data.draw(st.sampled_from(robot.link_names), label="link")
    joints = data.draw(st.lists(st.sampled_from(robot.joint_names), unique=True), label="joints")
    part = robot.subtree([link], joints=joints, posture=q)
    assert set(part.joint_names) == set(joints)
    columns = [robot.joint_index(name) for name in part.joint_names]
    pose, jacobian = bk.kinematics(robot).pose_and_jacobian(q, link)
    part_pose, part_jacobian = bk.kinematics(part).pose_and_jacobian(q[columns], link)
    torch.testing.assert_close(part_pose, pose, atol=1e-14, rtol=0)
    torch.testing.assert_close(part_jacobian, jacobian[:, columns], atol=1e-14, rtol=0)


def test_welding_takes_a_posture_by_name_or_by_number():
    robot = tricky()
    by_name = robot.subtree(["nail"], joints=["slide"], posture={"base": 0.5})
    by_number = robot.subtree(["nail"], joints=["slide"], posture=[0.0, 0.0, 0.5, 0.0])
    assert by_name.tree == by_number.tree
    with pytest.raises(InvalidPosture):
        robot.subtree(["nail"], posture=[0.0] * 3)
    with pytest.raises(UnknownName):
        robot.subtree(["nail"], posture={"elbow": 1.0})


def test_one_joint_and_none():
    assert bk.Robot.from_urdf(ONE_JOINT).n == 1
    statue = bk.Robot.from_urdf(STATUE)
    assert statue.joint_names == ()
    assert statue.named([]) == {}
    assert statue.lower.shape == (0,)


def test_other_origins_are_read_back_as_they_were_given():
    robot = infant()
    rng = np.random.default_rng(0)
    origins = {}
    for joint in robot.tree.joints[:9]:
        pose = transforms.transform(transforms.rpy_matrix(rng.uniform(-3, 3, 3).tolist()), rng.standard_normal(3))
        origins[joint.name] = pose
    moved = robot.with_origins(origins)
    again = bk.Robot.from_urdf(moved.to_urdf())
    for one in (moved, again):
        for joint in one.tree.joints:
            wanted = origins.get(joint.name, next(j.origin for j in robot.tree.joints if j.name == joint.name))
            np.testing.assert_allclose(joint.origin, wanted, atol=5e-15)
    assert moved.geometry == robot.geometry
    with pytest.raises(UnknownName, match="joint"):
        robot.with_origins({"no such joint": np.eye(4)})
