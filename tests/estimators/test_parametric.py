"""A body with every measure a little off: right where nothing is, exact in every derivative, a URDF like any other."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.optimize
import torch

import bodyimage_kin as bk
from bodyimage_kin.estimators.evidence import Images, Planes, Points, Touches
from bodyimage_kin.estimators.intrinsics import Intrinsics
from bodyimage_kin.estimators.map_fit import maximum_a_posteriori
from bodyimage_kin.estimators.parametric import Mount, Parameter, ParametricBody
from bodyimage_kin.robot import transforms

STEP = 1e-6
HAND = np.array([0.01, 0.02, 0.03])


@pytest.fixture(scope="module")
def setup(body):
    """The infant with a camera, a hand, a skin and a tracker that may be off, at postures near its face."""
    mounts = [
        Mount("camera", "camera", body.camera.link, body.camera.link_T_camera.numpy()),
        Mount("hand", "hand", body.hand.link, np.eye(4)),
        Mount("skin", "skin", body.skin.link, np.eye(4)),
        Mount("tracker", "tracker", body.robot.root, np.eye(4)),
    ]
    intrinsics = Intrinsics.of("camera", body.camera.model)
    plane = [Parameter(f"plane: {name}", "plane", "m") for name in "abd"]
    parametric = ParametricBody(body.felt_robot, body.joints, mounts, (*intrinsics.parameters, *plane))
    rng = np.random.default_rng(0)
    q = body.touch_postures(range(0, 441, 40), distance=0.03).numpy()
    q += 0.05 * rng.standard_normal(q.shape)
    return parametric, intrinsics, q


def offsets(q):
    return np.broadcast_to(HAND, (len(q), 3))


def evidence(setup):
    parametric, intrinsics, q = setup
    first = parametric.parameters.index(intrinsics.parameters[0])
    shared = (parametric, q, offsets(q), None, "hand")
    return [
        Images("images", *shared, "camera", intrinsics, first, np.zeros((len(q), 2))),
        Points("points", *shared, "tracker", np.zeros((len(q), 3))),
        Touches("touches", *shared, "skin", np.zeros((len(q), 3))),
        Planes("plane", *shared, len(parametric.parameters) - 3, np.array([0.6, 0.0, 0.8]), 0.1),
    ]


def drawn(parametric, size=0.1, seed=0):
    return size * np.random.default_rng(seed).standard_normal(len(parametric.parameters))


def test_nothing_off_is_the_body_itself(setup, body):
    parametric, _, q = setup
    frames = parametric.frames(q, np.zeros(len(parametric.parameters)))
    place, slope = frames["hand"].point(np.broadcast_to(body.hand.offset.numpy(), (len(q), 3)))
    postures = torch.from_numpy(q)
    np.testing.assert_allclose(place, body.hand_position(postures), atol=1e-14)
    np.testing.assert_allclose(frames["camera"].seen(place, slope)[0], body.hand_in_camera(postures), atol=1e-14)
    np.testing.assert_allclose(frames["skin"].seen(place, slope)[0], body.hand_in_skin(postures), atol=1e-14)


@pytest.mark.parametrize("kind", range(4), ids=["images", "points", "touches", "plane"])
@pytest.mark.parametrize("size", [0.0, 1e-3, 0.2, 1.5])
def test_derivatives_are_those_of_the_residuals(setup, kind, size):
    term, parametric = evidence(setup)[kind], setup[0]
    theta = drawn(parametric, size)
    # Shifts of metres and depths near zero are no bodies: only turns are large.
    turns = np.array([one.unit == "rad" for one in parametric.parameters])
    theta = np.where(turns, theta, np.clip(theta, -0.005, 0.005))
    if kind == 0 and size > 0.2:
        pytest.skip("a camera turned that far does not see the hand")
    _, slope = term.residual(theta)
    for index, direction in enumerate(np.eye(len(theta))):
        ahead, behind = (term.residual(theta + sign * STEP * direction)[0] for sign in (1, -1))
        difference = (ahead - behind) / (2 * STEP)
        np.testing.assert_allclose(
            slope[:, :, index],
            difference,
            atol=2e-9 * max(1.0, np.abs(slope).max()),
            err_msg=parametric.parameters[index].name,
        )


def test_a_corrected_joint_turns_about_the_corrected_axis(setup):
    parametric, _, _ = setup
    theta = drawn(parametric, 0.1)
    origins = parametric.corrected(theta)
    for joint in parametric.joints:
        pose = origins[joint.name]
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-14)
    zero = parametric.corrected(np.zeros(len(theta)))
    tilt = next(index for index, one in enumerate(parametric.parameters) if "zero of its encoder" in one.name)
    theta = np.zeros(len(theta))
    theta[tilt] = 0.3
    joint = parametric.joints[tilt // 6]
    turned = parametric.corrected(theta)[joint.name]
    # An encoder's zero turns about the axis itself, so the axis stays.
    np.testing.assert_allclose(turned[:3, :3] @ joint.axis, zero[joint.name][:3, :3] @ joint.axis, atol=1e-15)


def test_what_is_found_is_what_was_off(setup):
    parametric, _, q = setup
    term = evidence(setup)[0]
    group = np.array([one.group for one in parametric.parameters])
    free = np.isin(group, ["axes", "offsets"])
    sd = np.where(group == "axes", 0.05, 0.005)
    rng = np.random.default_rng(3)
    many = np.tile(q, (20, 1)) + 0.03 * rng.standard_normal((20 * len(q), q.shape[1]))
    term = dataclasses.replace(term, q=many, offset=offsets(many), image=np.zeros((len(many), 2)))
    for noise in (1e-6, 2e-4):
        within = []
        for seed in range(4):
            true = np.where(free, drawn(parametric, 1.0, seed) * sd, 0.0)
            image = term.residual(true)[0] + noise * rng.standard_normal((len(many), 2))
            fit = maximum_a_posteriori([dataclasses.replace(term, image=image)], free=free, sd=sd)
            assert fit.sigma[0] == pytest.approx(noise, rel=0.3)
            away = (fit.theta - true)[free]
            width = np.sqrt(np.diag(fit.covariance)[free])
            within.append((away / width) ** 2)
            assert (np.diag(fit.covariance)[~free] == 0).all()
            assert (fit.theta[~free] == 0).all()
        # Errors are as large as the posterior says: mean of squared normal variables, 100 of them (not independent).
        assert 0.5 < np.mean(within) < 2.0


def test_robust_costs_bear_outliers_that_squares_do_not(setup):
    parametric, _, q = setup
    term = evidence(setup)[2]
    group = np.array([one.group for one in parametric.parameters])
    free, sd = group == "skin", np.full(len(group), 0.02)
    many = np.tile(q, (10, 1)) + 0.1 * np.random.default_rng(1).standard_normal((10 * len(q), q.shape[1]))
    term = dataclasses.replace(term, q=many, offset=offsets(many), target=np.zeros((len(many), 3)))
    true = np.where(free, drawn(parametric, 0.01), 0.0)
    rng = np.random.default_rng(2)
    target = term.residual(true)[0] + 1e-3 * rng.standard_normal((len(many), 3))
    target[:12] += 0.2
    term = dataclasses.replace(term, target=target)
    robust, squares = (maximum_a_posteriori([term], free=free, sd=sd, robust=one) for one in (True, False))
    width = np.sqrt(np.diag(robust.covariance)[free])
    assert np.abs((robust.theta - true)[free] / width).max() < 4.0
    assert np.abs((squares.theta - true)[free] / width).max() > 20.0


def test_two_kinds_of_evidence_weigh_by_their_noise(setup):
    parametric, _, _q = setup
    terms = evidence(setup)
    group = np.array([one.group for one in parametric.parameters])
    free, sd = group == "hand", np.full(len(group), 0.02)
    one, other = dataclasses.replace(terms[1], sigma=1e-4), dataclasses.replace(terms[2], sigma=1e-1)
    shift = np.where(free & (np.arange(len(group)) % 6 == 0), 0.01, 0.0)
    one = dataclasses.replace(one, observed=one.residual(shift)[0])
    other = dataclasses.replace(other, target=other.residual(-shift)[0])
    fit = maximum_a_posteriori([one, other], free=free, sd=sd)
    assert fit.stated
    assert np.abs(fit.residuals[0]).max() < 1e-5
    assert np.abs(fit.residuals[1]).max() > 0.01


def slide():
    """A rail, then a wrist, an eye on the cart."""
    robot = bk.Robot.from_urdf(
        """<robot name="slide"><link name="base"/><link name="cart"/><link name="hand"/>
        <joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><origin xyz="0 0 1" rpy=".3 0 1"/>
        <axis xyz=".6 .8 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
        <joint name="wrist" type="revolute"><parent link="cart"/><child link="hand"/><origin xyz="0 .1 0"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    poses = [transforms.transform(transforms.rpy_matrix((0.1, 0.2, k)), (k, 0.0, 0.1)) for k in (0.3, 0.4, 0.5)]
    links = [("hand", "hand"), ("camera", "cart"), ("tracker", "base")]
    mounts = [Mount(name, name, link, pose) for (name, link), pose in zip(links, poses, strict=True)]
    return ParametricBody(robot, ("rail", "wrist"), mounts)


@pytest.mark.parametrize("size", [0.0, 1e-5, 0.1, 1.5])
@pytest.mark.parametrize("slides", [False, True])
def test_one_compiled_pass_gives_what_frames_give(setup, size, slides, monkeypatch):
    parametric, _, q = setup
    if slides:
        parametric, q = slide(), np.random.default_rng(4).uniform(-1.0, 1.0, (40, 2))
    theta = drawn(parametric, size)
    # Offsets that differ from sample to sample, as contacts at several places of a finger do.
    where = HAND + 0.01 * np.random.default_rng(5).standard_normal((len(q), 3))
    frames = parametric.frames(q, theta)
    for mount in frames:
        for observer in (None, *frames):
            place, slope = frames[mount].point(where)
            if observer is not None:
                place, slope = frames[observer].seen(place, slope)
            found = parametric.seen(q, theta, mount, where, observer)
            monkeypatch.setattr("bodyimage_kin.estimators.parametric.compiles", lambda: False)
            otherwise = parametric.seen(q, theta, mount, where, observer)
            monkeypatch.undo()
            for one, other, expected in zip(found, otherwise, (place, slope), strict=True):
                np.testing.assert_allclose(one, expected, rtol=1e-12, atol=1e-12)
                np.testing.assert_array_equal(other, expected)


@pytest.mark.parametrize("prior", [True, False])
@pytest.mark.parametrize("rows", [12, 40])
def test_a_descent_on_few_rows_ends_where_one_on_all_rows_ends(setup, prior, rows):
    """With a prior, where rounding allows to square, and without, where directions that nothing tells must not move."""
    parametric, _, q = setup
    free = np.array([one.group in ("axes", "offsets", "hand") for one in parametric.parameters])
    sd = np.full(len(free), 0.02 if prior else np.inf)
    many = np.tile(q, (4, 1))[:rows] + 0.05 * np.random.default_rng(6).standard_normal((rows, q.shape[1]))
    term = Points("points", parametric, many, offsets(many), 1e-3, "hand", "tracker", np.zeros((rows, 3)))
    observed = term.residual(drawn(parametric, 0.01))[0]
    term = dataclasses.replace(term, observed=observed + 1e-3 * np.random.default_rng(7).standard_normal((rows, 3)))
    fit = maximum_a_posteriori([term], free=free, sd=sd, robust=False)

    def at(values):
        theta = np.zeros(len(free))
        theta[free] = values
        r, slope = term.residual(theta)
        prior_rows = np.diag(1.0 / sd[free])
        return (
            np.concatenate([r.ravel() / 1e-3, prior_rows @ values]),
            np.vstack([slope.reshape(r.size, -1)[:, free] / 1e-3, prior_rows]),
        )

    end = scipy.optimize.least_squares(
        lambda values: at(values)[0],
        np.zeros(int(free.sum())),
        lambda values: at(values)[1],
        x_scale=np.where(np.isfinite(sd), sd, 1.0)[free],
        xtol=1e-10,
        ftol=1e-10,
        gtol=1e-10,
    )
    assert fit.cost == pytest.approx(end.cost, rel=1e-8)
    if prior:
        np.testing.assert_allclose(fit.theta[free], end.x, atol=1e-7)
    else:
        assert np.linalg.norm(fit.theta[free]) == pytest.approx(np.linalg.norm(end.x), rel=1e-3)


def test_prismatic_joints_have_their_zero_along_the_axis():
    robot = bk.Robot.from_urdf(
        """<robot name="slide"><link name="base"/><link name="cart"/><link name="hand"/>
        <joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><origin xyz="0 0 1"/>
        <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
        <joint name="wrist" type="revolute"><parent link="cart"/><child link="hand"/><origin xyz="0 .1 0"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    assert robot.n == 2
    parametric = ParametricBody(robot, ("rail", "wrist"), [Mount("hand", "hand", "hand", np.eye(4))])
    names = [one.name for one in parametric.parameters[:6]]
    assert names[2] == "rail: zero of its encoder"
    assert parametric.parameters[2].group == "encoders"
    assert parametric.parameters[2].unit == "m"
    assert parametric.parameters[5].group == "axes"
