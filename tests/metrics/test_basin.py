"""Laws of the servo's basin, on a planar arm of three links, a linear robot and the infant."""

import numpy as np
import pytest
from planar_arm import image, jacobian

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.estimators.analytic import AnalyticJacobian
from bodyimage_kin.metrics import basin

GOALS = np.array([[0.3, 1.2, 0.4], [-0.5, 1.5, -0.6], [2.0, -1.4, -0.3]])
LIMITS = {"lower": np.full(3, -3.0), "upper": np.full(3, 3.0)}


def rotated(q, angle=np.pi / 6):
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]]) @ jacobian(q)


def run(estimated=jacobian, goals=GOALS, **settings):
    return metrics.servo_basin(image, jacobian, estimated, goals, **(LIMITS | settings))


@pytest.mark.parametrize("estimated", [jacobian, rotated])
def test_perfect_and_mildly_rotated_estimates_converge_from_everywhere(estimated):
    found = run(estimated)
    np.testing.assert_array_equal(found.converged, 1)
    np.testing.assert_array_equal(found.share, 1)
    np.testing.assert_array_equal(found.radius, 0.05)
    np.testing.assert_array_equal(found.unreached, 0)


@pytest.mark.parametrize("factor", [0.0, -1.0, -0.1])
def test_zero_and_flipped_estimates_converge_from_nowhere(factor):
    found = run(lambda q: factor * jacobian(q))
    np.testing.assert_array_equal(found.converged, 0)
    np.testing.assert_array_equal(found.radius, 0)


def test_an_estimate_of_rank_one_has_no_basin():
    found = run(lambda q: jacobian(q) * [[1.0], [0.0]])
    np.testing.assert_array_equal(found.radius, 0)
    assert (found.share < 0.5).all()


@pytest.mark.parametrize("factor", [0.08, 0.095, 0.11, 0.15, 3.0])
def test_near_the_goal_the_critical_gain_decides(factor):
    J = jacobian(GOALS)
    stable = metrics.critical_gain(metrics.servo_matrix(J, factor * J)) > 0.2
    found = run(lambda q: factor * jacobian(q), distances=[0.002], damping=1e-3, steps=300)
    np.testing.assert_array_equal(found.converged, np.broadcast_to(stable[:, None, None], found.converged.shape))


def test_a_scale_of_the_estimate_is_one_over_the_gain():
    scaled, slower = run(lambda q: 4 * rotated(q, 1.3), gain=0.8), run(lambda q: rotated(q, 1.3), gain=0.2)
    np.testing.assert_array_equal(scaled.converged, slower.converged)
    assert 0 < scaled.share.mean() < 1


def test_starts_lie_where_they_should():
    found = run(directions=4)
    np.testing.assert_allclose(found.directions, [[1, 0], [0, 1], [-1, 0], [0, -1]], atol=1e-15)
    offsets = image(found.starts) - image(GOALS)[:, None, None]
    np.testing.assert_allclose(
        offsets, np.broadcast_to(found.distances[:, None, None] * found.directions, (3, 5, 4, 2)), atol=1e-7
    )


def test_limits_are_respected_and_starts_beyond_them_are_no_trials():
    lower, upper = GOALS[0] - [0.2, 0.2, 0.05], GOALS[0] + [0.1, 0.3, 0.05]
    asked = []

    def watched(q):
        asked.append(q)
        return image(q)

    found = metrics.servo_basin(watched, jacobian, rotated, GOALS[:1], lower=lower, upper=upper)
    asked = np.concatenate(asked)
    assert ((asked >= lower) & (asked <= upper)).all()
    missing = np.isnan(found.converged)
    np.testing.assert_array_equal(missing, np.isnan(found.starts).any(-1))
    assert 0 < missing.sum() < missing.size
    assert found.unreached[0] == missing.sum()
    assert found.share[0] == found.converged[~missing].mean()


def test_a_joint_at_its_limit_leaves_the_way_to_the_others():
    # The first joint may only turn one way; the other two still reach any direction.
    found = run(goals=GOALS[:1], lower=[GOALS[0, 0], -3.0, -3.0], distances=[0.005, 0.01])
    np.testing.assert_array_equal(found.unreached, 0)


def test_continuous_joints_have_no_limits():
    free = {"lower": np.full(3, -np.inf), "upper": np.full(3, np.inf)}
    np.testing.assert_array_equal(run(**free).converged, run().converged)


def test_nothing_happens_where_the_hand_has_no_image():
    x, _ = image(GOALS)[0]
    edge = x + 0.015

    def partial(q):
        return np.where(image(q)[:, :1] < edge, image(q), np.nan)

    def seen(field):
        def picky(q):
            assert (image(q)[:, 0] < edge).all()
            return field(q)

        return picky

    def turned(q):
        return rotated(q, -1.2)

    found = metrics.servo_basin(partial, seen(jacobian), seen(turned), GOALS[:1], **LIMITS, steps=300)
    wanted = x + found.distances[:, None] * found.directions[:, 0]
    assert np.isnan(found.converged[0, wanted >= edge]).all()
    # Turned this far it spirals inwards: wide spirals lose sight, narrow ones arrive.
    assert run(turned, GOALS[:1], steps=300).share == 1
    assert 0.01 <= found.radius[0] < 0.05
    assert (found.converged[0] == 0).any()


def test_an_estimate_that_is_not_finite_diverges():
    found = run(lambda q: np.full((len(q), 2, 3), np.nan))
    np.testing.assert_array_equal(found.converged, 0)
    # Near enough is not enough when the next step is unknown.
    near = image(GOALS[:1])
    blind = run(
        lambda q: np.where(np.linalg.norm(image(q) - near, axis=-1)[:, None, None] < 5e-4, np.nan, jacobian(q)),
        GOALS[:1],
    )
    np.testing.assert_array_equal(blind.converged, 0)


@pytest.mark.parametrize(("field", "at_most"), [(lambda q: 0 * jacobian(q), 1), (jacobian, 45)])
def test_what_is_settled_is_not_asked_again(field, at_most):
    asked = []

    def counted(q):
        asked.append(len(q))
        return field(q)

    run(counted)
    assert len(asked) <= at_most


def test_goals_do_not_know_of_each_other(monkeypatch):
    together = run(lambda q: rotated(q, 1.3))
    for goal in range(3):
        alone = run(lambda q: rotated(q, 1.3), GOALS[goal : goal + 1])
        np.testing.assert_array_equal(alone.converged[0], together.converged[goal])
        np.testing.assert_allclose(alone.starts[0], together.starts[goal], rtol=1e-12)
    monkeypatch.setattr(basin, "_CHUNK", 50)
    np.testing.assert_array_equal(run(lambda q: rotated(q, 1.3)).converged, together.converged)


def test_the_same_again_is_the_same():
    one, other = run(rotated), run(rotated)
    np.testing.assert_array_equal(one.converged, other.converged)
    np.testing.assert_array_equal(one.starts, other.starts)


def test_a_goal_without_posture_or_image_has_no_trial():
    goals = np.concatenate([GOALS[:1], np.full((1, 3), np.nan)])
    found = run(goals=goals)
    assert found.radius[0] == 0.05
    assert np.isnan(found.converged[1]).all()
    assert np.isnan([found.radius[1], found.share[1]]).all()
    assert found.unreached.tolist() == [0, 40]


def test_radius_by_hand():
    outcomes = {
        0.03: [[1, 1], [1, 1], [1, np.nan]],
        0.01: [[1, 1], [1, 0], [1, 1]],
        0.0: [[1, 0], [1, 1], [1, 1]],
        0.011: [[np.nan, 1], [np.nan, np.nan], [1, 1]],
        np.nan: [[np.nan, np.nan], [1, 1], [1, 1]],
    }
    converged = np.array(list(outcomes.values()), dtype=float)
    found = metrics.Basin(converged, np.zeros((5, 3, 2, 1)), np.array([0.01, 0.02, 0.03]), np.eye(2))
    np.testing.assert_allclose(found.radius, [0.03, 0.01, 0, 0.01, np.nan])
    np.testing.assert_allclose(found.share, [1, 5 / 6, 5 / 6, 1, 1])
    np.testing.assert_array_equal(found.unreached, [1, 0, 0, 3, 2])


@pytest.mark.parametrize("m", [1, 3])
def test_images_of_other_dimensions(m):
    A = np.random.default_rng(0).normal(size=(m, 4))
    free = {"lower": np.full(4, -9.0), "upper": np.full(4, 9.0)}
    fields = (lambda q: q @ A.T, lambda q: np.broadcast_to(A, (len(q), m, 4)))
    found = metrics.servo_basin(fields[0], fields[1], fields[1], np.zeros((2, 4)), **free)
    assert found.directions.shape == (8, m)
    np.testing.assert_allclose(np.linalg.norm(found.directions, axis=-1), 1)
    np.testing.assert_array_equal(found.radius, 0.05)
    found = metrics.servo_basin(fields[0], fields[1], fields[1], np.zeros((2, 4)), **free, directions=2 * np.eye(m))
    np.testing.assert_array_equal(found.directions, np.eye(m))


def test_a_body_and_its_estimators_fit():
    body = bk.load_embodiment("infant")
    found = metrics.servo_basin(
        lambda q: body.hand_image(q, on_invisible="nan"),
        body.hand_image_jacobian,
        AnalyticJacobian(body).jacobian,
        body.touch_postures([0, 220, 440]),
        lower=body.felt_robot.lower,
        upper=body.felt_robot.upper,
    )
    np.testing.assert_array_equal(found.radius, 0.05)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gain": 0.0}, "gain=0.0: give"),
        ({"damping": 0.0}, "damping=0.0: give"),
        ({"steps": 0}, "steps=0: give"),
        ({"tolerance": -1.0}, "tolerance=-1.0: give"),
        ({"directions": 0}, "directions=0: give"),
        ({"distances": [0.01, 0.005]}, "distances=.*ascending"),
        ({"distances": [0.0005, 0.005]}, "greater than the tolerance"),
    ],
)
def test_settings_out_of_range_are_named(settings, message):
    with pytest.raises(InvalidConfig, match=message):
        run(**settings)


def test_what_does_not_fit_is_named():
    with pytest.raises(InvalidArray, match=r"goals has shape \(3,\)"):
        run(goals=GOALS[0])
    with pytest.raises(InvalidArray, match="no finite posture"):
        run(goals=GOALS * np.nan)
    with pytest.raises(InvalidArray, match="lower not above upper"):
        run(lower=np.full(3, 4.0))
    with pytest.raises(InvalidArray, match="directions must be"):
        run(directions=np.eye(3))
    with pytest.raises(InvalidArray, match=r"the value of estimated_jacobian has shape \(\d+, 2\)"):
        run(image)
    with pytest.raises(InvalidArray, match="the value of image"):
        metrics.servo_basin(lambda q: q[0], jacobian, jacobian, GOALS, **LIMITS)
