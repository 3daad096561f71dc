"""Laws of the dragged hand and its passive arm."""

import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidURDF, Unreachable
from bodyimage_kin.recordings import Drag, Noise, dynamics, first_taxel, mujoco_model, simulate, simulate_many
from bodyimage_kin.recordings.contacts import Contacts, find_contacts, touched_taxels
from bodyimage_kin.recordings.dynamics import Course, drag
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.recordings.mujoco_model import joint_columns
from bodyimage_kin.robot.nearest import nearest_on_shapes
from bodyimage_kin.robot.shapes import Shape
from bodyimage_kin.robot.transforms import axis_angle_matrix, transform

NOISE = Noise(torque=0.1)
URDF = Path(__file__).parents[2] / "urdf"


@pytest.fixture(scope="module")
def body():
    return bk.load_embodiment("infant")


@pytest.fixture(scope="module")
def touch(body):
    """20 seconds of noisy touch: q and contacts."""
    return simulate(body, RandomTouch(20.0), seed=1, noise=NOISE)


def build(body, **changes):
    settings = {"step": 0.002, "stiffness": 60.0, "damping": 4.0, "joint_damping": 0.025, "rest_stiffness": 0.05}
    return mujoco_model.build(body, **{**settings, "friction": 0.0, **changes})


def some_postures(body, count, seed=0):
    q = np.random.default_rng(seed).random((count, body.p))
    return body.felt_robot.lower.numpy() + q * (body.felt_robot.upper - body.felt_robot.lower).numpy()


def hand_in_skin(body, q):
    return body.hand_in_skin(torch.as_tensor(q)).numpy()


def other_body(tmp_path, joints, change=lambda urdf: urdf):
    """The infant with other felt joints, or another URDF; the wrist is at zero at home."""
    table = re.sub("joints = .*", f"joints = {json.dumps(joints)}", (URDF / "infant.toml").read_text())
    table = re.sub("left_wrist = .*", "", table)
    (tmp_path / "other.toml").write_text(table)
    (tmp_path / "infant.urdf").write_text(change((URDF / "infant.urdf").read_text()))
    return bk.load_embodiment(tmp_path / "other.toml")


# The model -----------------------------------------------------------------------------------------------------------


def test_mujoco_and_pinocchio_agree_on_the_hand_along_a_recording(body, touch):
    model = build(body)
    data = mujoco.MjData(model)
    for q, position in zip(touch.true_q.values[0, ::10], touch.true_hand_position.values[0, ::10], strict=True):
        data.qpos[joint_columns(model)] = q
        mujoco.mj_kinematics(model, data)
        assert np.abs(data.site("hand").xpos - position).max() < 1e-9


def test_joints_keep_their_order_when_the_robot_branches(tmp_path):
    joints = ["right_elbow", "left_wrist", "left_elbow", "left_shoulder_yaw", "right_shoulder_roll", "left_hip_pitch"]
    body = other_body(tmp_path, joints)
    model = build(body)
    assert np.array_equal(model.jnt_range[:, 0], body.felt_robot.lower.numpy()[np.argsort(joint_columns(model))])
    data = mujoco.MjData(model)
    for q in some_postures(body, 5):
        data.qpos[joint_columns(model)] = q
        mujoco.mj_kinematics(model, data)
        assert np.abs(data.site("hand").xpos - body.hand_position(q).numpy()).max() < 1e-9


def test_drag_and_torque_are_exactly_what_is_said(body):
    model = build(body)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for q in some_postures(body, 10):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, rng.standard_normal(5), 0.1 * rng.standard_normal(6)
        mujoco.mj_forward(model, data)
        position, jacobian = body.hand_in_front_and_jacobian(torch.from_numpy(q))
        jacobian = jacobian.numpy()
        force = 60.0 * (data.ctrl[:3] - position.numpy()) - 4.0 * jacobian @ data.qvel
        pose, link_jacobian = body.kinematics.pose_and_jacobian(torch.from_numpy(q), body.hand.link)
        torque = pose[:3, :3].numpy() @ data.ctrl[3:]
        expected = jacobian.T @ force + link_jacobian[3:].numpy().T @ torque
        assert np.abs(data.qfrc_actuator - expected).max() < 1e-9 * np.abs(force).max()


def test_controls_put_the_damper_on_the_velocity_relative_to_the_target(body):
    # A target that moves evenly, and a hand that moves with it: no force.
    velocity = np.array([0.01, -0.02, 0.03])
    centres = np.array([0.1, 0.0, 0.05]) + np.arange(50)[:, None] * 0.002 * velocity
    course = Course(centres, body.felt_home.numpy(), np.random.default_rng(0))
    controls = dynamics._Controls(body, course, Drag(), 49, 0.0, 1).take(slice(0, 49))
    assert np.abs(60.0 * (controls[:, :3] - centres[:49]) - 4.0 * velocity).max() < 1e-9
    assert not controls[:, 3:].any()


def test_mass_is_that_of_the_links(body):
    model = build(body)
    arm = ("shoulder_pitch_link", "shoulder_roll_link", "upper_arm", "forearm", "palm", "hand")
    inertials = {link: body.robot.geometry[f"left_{link}"].inertial for link in arm}
    expected = sum(inertial.mass for inertial in inertials.values())
    assert model.body_mass.sum() == pytest.approx(expected, rel=1e-12)
    # Palm and fist move as one: their common inertia about an axis is that of two bodies apart.
    data = mujoco.MjData(model)
    data.qpos[:] = body.felt_home.numpy()
    mujoco.mj_forward(model, data)
    full = np.empty((5, 5))
    mujoco.mj_fullM(model, data, full)
    expected = np.zeros((5, 5))
    q = body.felt_home
    for link in arm:
        inertial = inertials[link]
        pose, jacobian = body.kinematics.pose_and_jacobian(q, f"left_{link}")
        pose, jacobian = pose.numpy(), jacobian.numpy()
        turned = pose[:3, :3] @ inertial.origin[:3, :3]
        linear = jacobian[:3] + np.cross(jacobian[3:].T, pose[:3, :3] @ inertial.origin[:3, 3]).T
        expected += inertial.mass * linear.T @ linear
        expected += jacobian[3:].T @ turned @ inertial.inertia @ turned.T @ jacobian[3:]
    assert np.abs(full - expected).max() < 1e-9 * np.abs(expected).max()


def test_energy_does_not_grow_without_drag(body):
    model = build(body, stiffness=0.0, damping=0.0)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = body.felt_home.numpy(), 2.0
    energies = []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        energies.append(data.energy.sum())
    assert energies[0] > 0.01
    assert np.diff(energies).max() <= 1e-12
    assert energies[-1] < 0.5 * energies[0]


def test_rest_is_an_equilibrium_of_the_springs(body):
    model = dynamics._at_rest(build(body, stiffness=0.0, damping=0.0), body.felt_home.numpy())
    data = mujoco.MjData(model)
    data.qpos[:] = body.felt_home.numpy()
    mujoco.mj_forward(model, data)
    assert not data.qfrc_passive.any()
    data.qpos[1] += 0.1
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive == pytest.approx([0.0, -0.005, 0.0, 0.0, 0.0], abs=1e-15)


# The motion ----------------------------------------------------------------------------------------------------------


def test_the_arm_starts_on_the_path_and_follows_it(body):
    led, dragged = (simulate(body, Circle(turns=0.5), seed=2, dynamics=dynamics) for dynamics in (False, True))
    assert np.abs(led.true_q[0, 0] - dragged.true_q[0, 0]).max() < 1e-9
    count = min(led.sizes["time"], dragged.sizes["time"])
    apart = (led.true_hand_position - dragged.true_hand_position)[:, :count]
    assert 1e-4 < float(np.sqrt((apart**2).sum("space")).max()) < 6e-3
    assert np.isfinite(dragged.hand_image).all()


def test_halving_the_step_changes_the_circle_little(body):
    coarse = simulate(body, Circle(), seed=2)
    fine = simulate(body, Circle(), seed=2, dynamics=Drag(step=0.001))
    count = min(coarse.sizes["time"], fine.sizes["time"])
    apart = np.abs((coarse.true_q - fine.true_q).values[:, :count]).max()
    assert apart < 4e-4
    assert np.abs((coarse.true_hand_position - fine.true_hand_position).values[:, :count]).max() < 4e-5


def test_the_hand_slides_on_the_skin_and_hardly_enters_it(body, touch):
    contacts = find_contacts(body.skin, hand_in_skin(body, touch.true_q.values[0]), body.hand.radius, 1e-3)
    assert contacts.penetration.max() < 1e-3
    assert (touch.true_touched >= 0).mean() > 0.95
    assert len(np.unique(touch.true_touched)) > 50
    quiet = simulate(body, FaceTour())
    contacts = find_contacts(body.skin, hand_in_skin(body, quiet.true_q.values[0]), body.hand.radius)
    assert contacts.penetration.max() < 1e-4
    assert (quiet.true_touched >= 0).all()
    assert contacts.penetration[1:].min() > 0.0


def test_touches_are_where_the_hand_is_led(body):
    tour = simulate(body, FaceTour())
    visited = body.skin.coordinates(first_taxel(tour, truth=True)[0])
    for name in ("mouth", "nose", "right_eye", "left_eye"):
        place = body.skin.coordinates(np.array([body.skin.landmarks[name]]))
        assert np.abs(visited - place).max(axis=1).min() <= 1.0, name


def test_joints_stop_at_their_limits(body):
    # Led across and down, or beside the head: out of reach of shoulder, yaw or elbow.
    share = np.linspace(0.0, 1.0, 2501)[:, None]
    start = body.touch_centres([220]).numpy()
    for way in ([0.0, -0.2, -0.2], [-0.1, 0.2, -0.1]):
        course = Course(start + share * way, body.felt_home.numpy(), np.random.default_rng(0))
        q = drag(body, [course], Drag(), Noise(), sampling=0.1)[0]
        beyond = np.maximum(body.felt_robot.lower.numpy() - q, q - body.felt_robot.upper.numpy())
        assert 0.0 < beyond.max() < 1e-3, way


# Random torques ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hold", [1, 5])
def test_torques_have_the_stated_distribution_and_hold(body, hold):
    course = Course(np.zeros((20001, 3)), body.felt_home.numpy(), np.random.default_rng(0))
    controls = dynamics._Controls(body, course, Drag(), 20000, 0.1, hold)
    torques = np.concatenate([controls.take(slice(0, 15000)), controls.take(slice(15000, 20000))])[:, 3:]
    assert np.array_equal(torques, np.repeat(torques[::hold], hold, axis=0))
    drawn = torques[::hold]
    assert len(np.unique(drawn)) == drawn.size
    count = len(drawn)
    assert np.abs(drawn.mean(0)).max() < 4 * 0.1 / np.sqrt(count)
    assert np.abs(np.cov(drawn.T) - 0.01 * np.eye(3)).max() < 4 * 0.01 * np.sqrt(2 / count)
    assert np.abs((drawn[1:] * drawn[:-1]).mean(0)).max() < 4 * 0.01 / np.sqrt(count)


def test_each_trial_has_torques_of_its_own_and_they_move_no_path(body, monkeypatch):
    seen = []

    def spy(body, courses, *others, **more):
        seen.append(courses)
        return drag(body, courses, *others, **more)

    monkeypatch.setattr(dynamics, "drag", spy)
    for noise in (None, NOISE):
        simulate(body, RandomTouch(1.0), trials=2, noise=noise)
    quiet, noisy = seen
    for one, other in zip(quiet, noisy, strict=True):
        assert np.array_equal(one.centres, other.centres)
        assert np.array_equal(one.rest, other.rest)
    assert not np.array_equal(*(course.noise.standard_normal(9) for course in noisy))
    assert not np.array_equal(*(course.rest for course in noisy))


def test_noise_excites_what_a_quiet_circle_leaves_still(body):
    quiet, noisy = (
        np.linalg.svd(np.diff(simulate(body, Circle(), noise=noise).q.values[0], axis=0), compute_uv=False)
        for noise in (None, NOISE)
    )
    assert quiet[4] / quiet[0] < 0.02
    assert noisy[4] / noisy[0] > 0.1


def test_the_longer_a_torque_is_held_the_more_it_moves(body):
    quiet = simulate(body, Circle(turns=0.5)).true_q.values
    brief, long = (
        simulate(body, Circle(turns=0.5), noise=Noise(torque=0.1, torque_hold=hold)).true_q.values
        for hold in (0.002, 0.1)
    )
    assert np.std(long - quiet) > 2 * np.std(brief - quiet) > 0.0


# The same bits -------------------------------------------------------------------------------------------------------


def test_threads_and_company_change_no_bit(body):
    motion = RandomTouch(11.0)
    one = simulate(body, motion, seed=7, noise=NOISE)
    three = simulate(body, motion, seed=7, trials=3, noise=NOISE)
    assert one.true_q.identical(three.true_q[:1])
    assert one.touched.identical(three.touched[:1])
    for threads in (1, 2):
        together = simulate_many(body, motion, [6, 7, 8], noise=NOISE, threads=threads)
        assert together[1].identical(one)
        assert together[0].attrs["config"] != one.attrs["config"]
    assert not np.allclose(three.true_q[0, 1:], three.true_q[1, 1:])


def test_a_shorter_motion_beside_a_longer_one_is_the_same(body):
    def course(count):
        centres = np.repeat(body.touch_centres([220])[:1].numpy(), count, axis=0)
        return Course(centres, body.felt_home.numpy(), np.random.default_rng(3), press=True)

    alone = drag(body, [course(5201)], Drag(), NOISE, sampling=0.1)[0]
    beside = drag(body, [course(6001), course(5201)], Drag(), NOISE, sampling=0.1)
    assert [len(q) for q in beside] == [121, 105]
    assert np.array_equal(alone, beside[1])
    assert np.array_equal(alone, beside[0][:105])


def test_many_without_dynamics_is_one_at_a_time(body):
    motion, both = Circle(turns=0.1), [1, 2]
    for recording, seed in zip(simulate_many(body, motion, both, trials=2, dynamics=False), both, strict=True):
        assert recording.identical(simulate(body, motion, seed, trials=2, dynamics=False))
    assert simulate_many(body, motion, []) == []


# Contacts ------------------------------------------------------------------------------------------------------------

TURNED = transform(axis_angle_matrix([0.6, 0.0, 0.8], 0.7), [0.01, -0.02, 0.03])
SHAPES = [
    Shape("sphere", (0.05,), TURNED),
    Shape("box", (0.03, 0.05, 0.07), TURNED),
    Shape("cylinder", (0.04, 0.06), TURNED),
    Shape("capsule", (0.03, 0.04), TURNED),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.kind)
def test_nearest_point_is_that_of_mujoco(shape):
    spec = mujoco.MjSpec()
    mujoco_model._add_shape(spec.worldbody, shape, np.eye(4))
    probe = spec.worldbody.add_body(mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
    for axis in np.eye(3):
        probe.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    probe.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0.0, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    centres = np.random.default_rng(0).uniform(-0.1, 0.1, (400, 3))
    points, normals, distances = nearest_on_shapes((shape,), centres)
    checked = 0
    for centre, point, normal, distance in zip(centres, points, normals, distances, strict=True):
        # Deep inside, where the nearest face jumps, nobody is dragged.
        if distance < -0.01:
            continue
        data.qpos[:] = centre
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        assert data.ncon == (distance < 0.02)
        if data.ncon:
            contact = data.contact[0]
            # From the first geom (the shape, unless MuJoCo swaps them) to the second.
            sign = 1.0 if contact.geom[0] == 0 else -1.0
            assert contact.dist == pytest.approx(distance - 0.02, abs=1e-12)
            assert np.abs(sign * contact.frame[:3] - normal).max() < 1e-6
            assert np.abs(contact.pos - contact.dist / 2 * normal - point).max() < 1e-6
            checked += 1
    assert checked > 10


def test_contacts_of_a_recording_are_those_of_mujoco(body, touch):
    model = build(body)
    data = mujoco.MjData(model)
    q = touch.true_q.values[0]
    contacts = find_contacts(body.skin, hand_in_skin(body, q), body.hand.radius)
    found = []
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found.append(data.contact[0].dist if data.ncon else np.nan)
    touching = ~np.isnan(found)
    # At the start the hand just touches, to rounding.
    clear = np.abs(contacts.penetration) > 1e-12
    assert np.array_equal(touching[clear], ~np.isnan(contacts.points[clear, 0]))
    assert 0.3 < touching.mean() < 1.0
    assert np.abs(np.array(found) + contacts.penetration)[touching].max() < 1e-12


def test_a_contact_on_a_taxel_is_that_taxel_and_off_the_patch_none(body):
    skin = body.skin
    every = np.arange(skin.count)
    centres = skin.link_positions + 0.9999 * body.hand.radius * skin.link_normals
    assert np.array_equal(touched_taxels(skin, find_contacts(skin, centres, body.hand.radius)), every)
    rows, columns = skin.shape
    for place, expected in [
        ([0.4, 0.4], 0),
        ([-0.4, 0.0], 0),
        ([-0.6, 0.0], -1),
        ([10.0, columns - 0.4], -1),
        ([10.0, columns - 0.6], 10 * columns + columns - 1),
        ([rows - 0.4, 3.0], -1),
    ]:
        points, normals = skin.surface_at(np.array([place]))
        assert touched_taxels(skin, Contacts(points, normals, np.zeros(1))) == [expected], place


def test_back_of_the_head_and_free_hand_touch_no_taxel(body):
    front = body.skin.link_positions[[220]] + 0.5 * body.hand.radius * body.skin.link_normals[[220]]
    middle = body.skin.surface[0].link_T_shape[:3, 3]
    back = 2 * middle - front
    centres = np.concatenate([front, back, front + np.array([1.0, 0.0, 0.0])])
    contacts = find_contacts(body.skin, centres, body.hand.radius)
    assert np.isnan(contacts.points).any(axis=1).tolist() == [False, False, True]
    assert touched_taxels(body.skin, contacts).tolist() == [220, -1, -1]


# Recordings and errors -----------------------------------------------------------------------------------------------


def test_recordings_tell_how_they_were_made(body, touch, tmp_path):
    assert json.loads(touch.attrs["config"])["noise"]["torque"] == 0.1
    bk.write_recording(touch, tmp_path / "touch.nc")
    assert bk.read_recording(tmp_path / "touch.nc").identical(touch)
    assert np.isnan(touch.hand_image).all()
    assert touch.at_reference[0, :5].all()
    images = touch.true_hand_image.values[0][touch.at_reference.values[0]]
    assert np.linalg.norm(images - touch.reference_image.values, axis=1).mean() < 5e-3


def test_paths_that_cannot_be_dragged_along_are_refused(body):
    with pytest.raises(InvalidConfig, match="does not see the hand"):
        simulate(body, Circle(turns=0.1, distance=0.0))
    with pytest.raises(Unreachable, match="cannot reach"):
        simulate(body, Circle(turns=0.02, radius=0.5))
    with pytest.raises(InvalidConfig, match="sampling"):
        simulate(body, Circle(sampling=0.1001))
    with pytest.raises(InvalidConfig, match="torque_hold"):
        simulate(body, Circle(turns=0.1), noise=Noise(torque=0.1, torque_hold=0.003))


def test_robots_that_cannot_be_dragged_are_refused(tmp_path):
    arm = ["left_shoulder_pitch", "left_shoulder_roll", "left_shoulder_yaw", "left_elbow", "left_wrist"]
    with pytest.raises(InvalidConfig, match="skin"):
        build(other_body(tmp_path, ["neck", *arm]))
    follow = '<child link="left_palm"/><mimic joint="left_elbow"/>'
    body = other_body(tmp_path, arm[:4], lambda urdf: urdf.replace('<child link="left_palm"/>', follow))
    with pytest.raises(InvalidConfig, match="'left_wrist' follows"):
        build(body)
    weightless = other_body(
        tmp_path, arm, lambda urdf: urdf.replace("<inertial>", "<!--").replace("</inertial>", "-->")
    )
    with pytest.raises(InvalidURDF, match="mass"):
        build(weightless)


@pytest.mark.parametrize(
    ("inertial", "problem"),
    [
        (
            '<inertial><mass value="heavy"/></inertial>',
            "mass and inertia are needed here: link 'left_palm', line .*'heavy'",
        ),
        ('<inertial><mass value="1"/></inertial>', "link 'left_palm': its inertial has no inertia; add <inertia>"),
    ],
)
def test_a_mass_that_cannot_be_read_is_an_error_where_it_is_needed(inertial, problem, tmp_path):
    def spoilt(urdf, link):
        start = urdf.index("<inertial>", urdf.index(f'<link name="{link}"'))
        return urdf[:start] + inertial + urdf[urdf.index("</inertial>", start) + len("</inertial>") :]

    arm = ["left_shoulder_pitch", "left_shoulder_roll", "left_shoulder_yaw", "left_elbow", "left_wrist"]
    with pytest.raises(InvalidURDF, match=problem):
        build(other_body(tmp_path, arm, lambda urdf: spoilt(urdf, "left_palm")))
    # No felt joint moves the other one.
    build(other_body(tmp_path, arm, lambda urdf: spoilt(urdf, "right_palm")))


def test_a_joint_without_limits_is_free_in_the_simulation_too(tmp_path):
    arm = ["left_shoulder_pitch", "left_shoulder_roll", "left_shoulder_yaw", "left_elbow", "left_wrist"]

    def freed(urdf):
        elbow = urdf.index('<joint name="left_elbow"')
        start = urdf.index("<limit", elbow)
        return urdf[:start] + urdf[urdf.index("/>", start) + 2 :]

    model = build(other_body(tmp_path, arm, freed))
    assert model.jnt_limited.tolist() == [1, 1, 1, 0, 1]


@pytest.mark.parametrize("trials", [1, 3])
def test_a_simulation_that_diverges_says_so_and_leaves_no_log(body, trials, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    unstable = Drag(stiffness=1e8, step=0.01)
    with pytest.raises(InvalidConfig, match="the dynamics diverge with drag: step"):
        simulate(body, Circle(turns=0.1), trials=trials, dynamics=unstable)
    assert not list(tmp_path.iterdir())
    assert not capfd.readouterr().err
    assert mujoco.get_mju_user_warning() is None
