"""A body that is proposed does what the paper's experiment needs; what cannot be proposed is said in words."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.body import _proposal_links, _proposal_skin
from bodyimage_kin.body.collisions import Hulls
from bodyimage_kin.body.proposal import propose
from bodyimage_kin.errors import BodyImageKinError

ARM = """
<robot name="two">
  <link name="base"/>
  <link name="head"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="upper"><collision><origin xyz="0.1 0 0"/><geometry><box size="0.16 0.02 0.02"/></geometry></collision>
  </link>
  <link name="lower"><collision><origin xyz="0.1 0 0"/><geometry><box size="0.16 0.02 0.02"/></geometry></collision>
  </link>
  <joint name="neck" type="fixed"><parent link="base"/><child link="head"/><origin xyz="0 {y} 0.3"/></joint>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.2 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def proposal():
    return propose(bk.load_embodiment("infant").robot, "left_hand", camera="right_eye")


def test_the_hand_of_a_proposed_body_is_seen_in_front_of_the_face_and_never_on_it(proposal):
    body = proposal.body
    assert proposal.works
    assert body.joints == bk.load_embodiment("infant").joints
    taxels = np.arange(body.skin.count)
    assert body.skin.shape == (21, 21)
    touching = body.touch_postures(taxels)
    assert not bool(body.visible(touching).any())
    assert bool(body.visible(body.felt_home))
    recording = bk.simulate(body, bk.motions.Circle(turns=1.0), dynamics=False)
    assert np.isfinite(recording.hand_image.values).all()
    tour = bk.simulate(body, bk.motions.FaceTour(), dynamics=False)
    assert set(np.unique(tour.touched)) - {-1} > {body.skin.landmarks["nose"]}


def test_home_is_clear_of_the_body_and_in_front_of_the_middle(proposal):
    body = proposal.body
    assert Hulls(body.robot, body.joints).collisions(body.home) == ()
    ahead = body.hand_in_skin(body.felt_home).numpy() - body.touch_centres([body.skin.middle])[0].numpy()
    np.testing.assert_allclose(ahead, 0.05 * body.skin.forward, atol=2e-3)  # joints are rounded to a milliradian


def test_a_proposal_says_why_and_is_written_and_read_back(proposal, tmp_path):
    told = " ".join(proposal.remarks)
    for part in ("eye:", "skin:", "joints:", "forward:", "hand:", "home:"):
        assert part in told
    assert bk.load_embodiment(proposal.body.save(tmp_path / "my.toml")) == proposal.body


def test_links_that_run_into_each_other_are_told_and_neighbours_never(proposal):
    body = proposal.body
    hulls = Hulls(body.robot, body.joints)
    inside = body.touch_postures([body.skin.middle], 0.0)[0]
    into_the_head, reached = body.reach(body.touch_centres([body.skin.middle], -0.04))
    assert bool(reached.all())
    hit = hulls.collisions(body.full_posture(into_the_head[0]))
    assert any({"head", "left_hand"} == set(pair) for pair in hit)
    assert not any("left_upper_arm" in pair and "left_forearm" in pair for pair in hit)
    assert not any({"head", "left_hand"} == set(pair) for pair in hulls.collisions(body.home))
    assert inside.shape == (body.p,)


@pytest.mark.parametrize(
    ("hand", "settings", "said"),
    [
        ("hand", {}, "hand"),
        ("left_hand", {"camera": "eye"}, "eye"),
        ("head", {}, "no joint moves link 'head'"),
        ("left_hand", {"forward": (0, 0, 1)}, "not vertical"),
        pytest.param("left_foot", {}, "gets no nearer than", marks=pytest.mark.slow),
    ],
)
def test_what_cannot_be_proposed_is_said(hand, settings, said):
    with pytest.raises(BodyImageKinError, match=said):
        propose(bk.load_embodiment("infant").robot, hand, **settings)


@pytest.mark.slow
def test_a_robot_whose_hand_stays_in_a_plane_below_the_face_is_told_how_far_it_gets():
    robot = bk.Robot.from_urdf(ARM.format(y=0))
    with pytest.raises(BodyImageKinError, match=r"gets no nearer than 3.. mm") as told:
        propose(robot, "lower")
    assert any("eye: on link 'head'" in note for note in told.value.__notes__)


def test_a_robot_without_eye_names_its_links():
    robot = bk.Robot.from_urdf(ARM.format(y=0).replace("head", "ball"))
    with pytest.raises(BodyImageKinError, match=r"named after an eye.*base, ball, upper"):
        propose(robot, "lower")


def test_where_the_robot_looks_is_where_its_hand_moves(proposal):
    assert any("forward: x of the root" in one for one in proposal.remarks)
    torch.testing.assert_close(torch.from_numpy(proposal.body.skin.forward), torch.tensor([1.0, 0, 0]).double())


HEAD = """
<robot name="screens">
  <link name="torso"><collision><geometry><box size="0.5 0.5 0.9"/></geometry></collision></link>
  <link name="head"><collision><geometry><sphere radius="0.001"/></geometry></collision></link>
  <link name="head_camera"/>
  <link name="screen"><visual><geometry><box size="{depth} 0.2 0.15"/></geometry></visual></link>
  <joint name="pan" type="revolute"><parent link="torso"/><child link="head"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="a" type="fixed"><parent link="head"/><child link="head_camera"/></joint>
  <joint name="b" type="fixed"><parent link="head"/><child link="screen"/><origin xyz="0.1 0 0" rpy="0 0.2 0"/></joint>
</robot>
"""


def test_what_is_fixed_to_a_head_can_be_its_face():
    said = []
    robot = bk.Robot.from_urdf(HEAD.format(depth=0.02))
    assert _proposal_links.skin_link(robot, "head_camera", None, None, said) == "screen"
    assert "as large as a face" in said[0]
    # Too small a screen: the nearest link above that is large enough.
    small = bk.Robot.from_urdf(HEAD.format(depth=0.02).replace("0.2 0.15", "0.2 0.05"))
    assert _proposal_links.skin_link(small, "head_camera", None, None, said) == "torso"


def test_a_slanted_plate_has_room_for_a_patch():
    robot = bk.Robot.from_urdf(HEAD.format(depth=0.001))
    root_T_screen = bk.kinematics(robot).pose(torch.zeros(1), "screen").numpy()
    axes = root_T_screen[:3, :3].T @ _proposal_links.axes_of((1.0, 0.0, 0.0))
    skin = _proposal_skin.face_patch(robot, "screen", axes, None, 1.0, [])
    assert skin.shape == (21, 21)
    np.testing.assert_allclose(skin.layout.size, (0.09, 0.12), atol=0.01)


@pytest.mark.slow
def test_a_robot_that_looks_the_other_way_is_proposed_the_other_way():
    # The hand moves ahead and reaches the near side of the head alone, which looks back.
    robot = bk.Robot.from_urdf(ARM.format(y=0).replace('xyz="0 0 0.3"', 'xyz="0.35 0 0"'))
    found = propose(robot, "lower")
    assert any("forward: x of the root" in one for one in found.remarks)
    assert any("the other way, -x of the root" in one for one in found.remarks)
    torch.testing.assert_close(torch.from_numpy(found.body.skin.forward), torch.tensor([-1.0, 0, 0]).double())


def test_links_that_move_with_a_hand_are_found_with_their_fingers():
    body = bk.load_embodiment("infant")
    hulls = Hulls(body.robot, body.joints)
    assert "left_hand" in hulls.beyond("left_forearm")
    assert "left_forearm" not in hulls.beyond("left_hand")
    assert "head" not in hulls.beyond("left_forearm")


@pytest.mark.slow
def test_joints_that_cannot_move_are_named_where_the_hand_gets_nowhere():
    stiff = ARM.format(y=0).replace('lower="-3" upper="3"', 'lower="0" upper="0"')
    with pytest.raises(BodyImageKinError, match=r"for 'b' cannot move \(look at <limit>\)") as told:
        propose(bk.Robot.from_urdf(stiff), "lower")
    assert any(note.count("gets no nearer") == 1 for note in told.value.__notes__)


def test_a_hand_is_its_middle_or_its_outer_end():
    hand = """<robot name="r"><link name="hand"><collision><origin xyz="{x} 0 0"/>
      <geometry><box size="0.2 0.04 0.06"/></geometry></collision></link></robot>"""
    for x in (0.1, -0.1):
        (middle, _), (end, said) = _proposal_skin.balls_of(bk.Robot.from_urdf(hand.format(x=x)), "hand", None)
        assert middle.radius == end.radius == 0.02
        np.testing.assert_allclose(middle.offset, [x, 0.0, 0.0])
        np.testing.assert_allclose(end.offset, [1.8 * x, 0.0, 0.0])
        assert "outer end" in said
    assert (
        len(list(_proposal_skin.balls_of(bk.Robot.from_urdf("<robot name='r'><link name='a'/></robot>"), "a", None)))
        == 1
    )
