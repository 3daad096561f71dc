"""Laws of the integrated hand estimate."""

import json

import numpy as np
import pytest
import torch
import xarray as xr

from bodyimage_kin.body_image import PostureToImage, integrate
from bodyimage_kin.errors import DataWarning, InvalidArray, InvalidConfig, InvalidRecording
from bodyimage_kin.estimators import ConstantJacobian

P, M = 3, 2
INITIAL = np.array([0.5, -0.25])


class Constant:
    """dr = J dq."""

    def __init__(self, J):
        self.J, self.calls = torch.as_tensor(J), 0

    def displacement(self, q, dq):
        self.calls += 1
        return dq @ self.J.T


class Curved:
    """Depends on the posture, is not linear in dq, and has a bias, as a learned one does."""

    def displacement(self, q, dq):
        return torch.stack([torch.sin(q[..., 0] + 3.0 * dq[..., 1]), q.cos().sum(-1) * dq.sum(-1)], dim=-1) + 0.01


class Exact:
    """The displacement along the straight line in joint space, of r = (cos q0, sin(q1) q2)."""

    def displacement(self, q, dq):
        return torch.stack(
            [
                -torch.sin(q[..., 0]) * dq[..., 0],
                torch.cos(q[..., 1]) * q[..., 2] * dq[..., 1] + torch.sin(q[..., 1]) * dq[..., 2],
            ],
            dim=-1,
        )


def image(q):
    return np.stack([np.cos(q[..., 0]), np.sin(q[..., 1]) * q[..., 2]], axis=-1)


def experience(q, at_reference=None, m=M, **extra):
    q = np.asarray(q, dtype=float)
    trials, times, _ = q.shape
    resting = np.zeros((trials, times), bool) if at_reference is None else at_reference
    return xr.Dataset(
        {
            "q": (("trial", "time", "joint"), q),
            "at_reference": (("trial", "time"), resting),
            "reference_image": (("axis",), np.linspace(0.1, 0.2, m), {"units": "m"}),
            **extra,
        },
        coords={"time": np.arange(times) * 0.1},
        attrs={"seed": 7},
    )


@pytest.fixture
def exp():
    rng = np.random.default_rng(3)
    q = rng.normal(size=(3, 40, P)).cumsum(axis=1) * 0.1
    resting = rng.random((3, 40)) < 0.15
    resting[0, :4] = [False, False, True, True]
    resting[1, 0] = True
    resting[2] = False
    resting[2, 30] = True
    q[1, 33:] = np.nan
    resting[1, 33:] = False
    return experience(q, resting, true_hand_image=(("trial", "time", "axis"), rng.normal(size=(3, 40, M))))


def step_by_step(exp, learned, reset, method, substeps, initial, posture_map):
    """The definition, one sample after the other."""
    estimate = np.full((*exp.q.shape[:2], M), np.nan)

    def displacement(q, dq):
        total = np.zeros(M)
        for j in range(substeps):
            at = q + (j + (0.5 if method == "midpoint" else 0.0)) / substeps * dq
            total += learned.displacement(torch.tensor(at)[None], torch.tensor(dq / substeps)[None])[0].numpy()
        return total

    for trial in range(exp.sizes["trial"]):
        r, origin, q_before = None, None, None
        for time in range(exp.sizes["time"]):
            q = exp.q.values[trial, time]
            if np.isnan(q).any():
                break
            if exp.at_reference.values[trial, time] and reset != "none":
                r = {
                    "posture_map": lambda q=q: posture_map(q[None])[0],
                    "true": lambda trial=trial, time=time: exp.true_hand_image.values[trial, time],
                }.get(reset, lambda: exp.reference_image.values)()
                origin = (q, r)
            elif time == 0:
                if initial is not None:
                    r, origin = initial, (q, initial)
            elif r is not None:
                r = origin[1] + displacement(origin[0], q - origin[0]) if reset == "secant" else (
                    r + displacement(q_before, q - q_before)
                )  # fmt: skip
            if r is not None:
                estimate[trial, time] = r
            q_before = q
    return estimate


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("method", ["euler", "midpoint"])
@pytest.mark.parametrize(
    ("reset", "initial"),
    [("none", INITIAL)]
    + [(reset, start) for reset in ("reference", "posture_map", "secant", "true") for start in (None, INITIAL)],
)
def test_batched_equals_step_by_step(exp, reset, method, substeps, initial):
    hand = integrate(exp, Curved(), reset, method, substeps, initial, posture_map=image)
    expected = step_by_step(exp, Curved(), reset, method, substeps, initial, image)
    np.testing.assert_allclose(hand, expected, rtol=0, atol=1e-12)
    assert np.isfinite(expected).any()


def test_a_constant_jacobian_returns_to_its_start_on_a_closed_loop():
    angle = np.linspace(0, 2 * np.pi, 201)
    q = np.stack([np.cos(angle), np.sin(angle), np.sin(2 * angle)], axis=-1)[None]
    J = np.random.default_rng(0).normal(size=(M, P))
    hand = integrate(experience(q), Constant(J), "none", initial=INITIAL)
    np.testing.assert_allclose(hand[0, -1], INITIAL, rtol=0, atol=1e-13)
    np.testing.assert_allclose(hand[0], INITIAL + (q[0] - q[0, 0]) @ J.T, rtol=0, atol=1e-13)


def test_midpoint_converges_faster_than_euler():
    q = np.linspace(0, 1, 21)[None, :, None] * np.array([1.0, -0.7, 0.4])
    exp = experience(q)

    def error(method, substeps):
        start = image(q[:, :1])[0, 0]
        return np.abs(integrate(exp, Exact(), "none", method, substeps, start).to_numpy() - image(q)).max()

    assert error("euler", 1) / error("euler", 4) == pytest.approx(4, rel=0.1)
    assert error("midpoint", 1) / error("midpoint", 4) == pytest.approx(16, rel=0.1)
    assert error("midpoint", 1) < error("euler", 4)


def test_learned_is_called_once_and_never_with_a_padded_posture(exp):
    learned = Constant(np.ones((M, P)))
    integrate(exp, learned)
    assert learned.calls == 1

    class Strict(Constant):
        def displacement(self, q, dq):
            assert torch.isfinite(q).all()
            assert torch.isfinite(dq).all()
            return super().displacement(q, dq)

    integrate(exp, Strict(np.ones((M, P))), substeps=2)


def test_blocks_change_nothing(exp, monkeypatch):
    whole = integrate(exp, Curved(), substeps=2)
    monkeypatch.setattr("bodyimage_kin.body_image.integration._BLOCK", 7)
    np.testing.assert_allclose(integrate(exp, Curved(), substeps=2), whole, rtol=0, atol=1e-14)


def test_nan_exactly_before_the_first_reset_and_where_padded(exp):
    hand = integrate(exp, Curved())
    started = np.maximum.accumulate(exp.at_reference.values, axis=1)
    np.testing.assert_array_equal(np.isfinite(hand).all("axis"), started & np.isfinite(exp.q).all("joint").values)
    assert np.array_equal(
        hand.values[exp.at_reference.values], np.broadcast_to(exp.reference_image, (int(exp.at_reference.sum()), M))
    )


def test_an_explosion_ends_at_the_next_reset():
    q = np.arange(6.0)[None, :, None] * np.ones(P)
    resting = np.array([[True, False, False, True, False, False]])

    class Exploding(Constant):
        def displacement(self, q, dq):
            return torch.where(q[:, :1] == 1.0, torch.inf, super().displacement(q, dq))

    hand = integrate(experience(q, resting), Exploding(np.ones((M, P))))
    assert np.isinf(hand[0, 2]).all()
    np.testing.assert_allclose(hand[0, 5], [0.1 + 6, 0.2 + 6])


def test_a_gap_is_unknown_until_the_next_reset():
    q = np.arange(6.0)[None, :, None] * np.ones(P)
    q[0, 2] = np.nan
    resting = np.array([[True, False, False, False, True, False]])
    known = np.isfinite(integrate(experience(q, resting), Curved())).all("axis").values
    np.testing.assert_array_equal(known, [[True, True, False, False, True, True]])


def test_initial_may_differ_by_trial_and_m_is_free():
    q = np.random.default_rng(0).normal(size=(2, 5, P))
    initial = np.arange(6.0).reshape(2, 3)
    hand = integrate(experience(q, m=3), Constant(np.ones((3, P))), "none", initial=initial)
    np.testing.assert_array_equal(hand[:, 0], initial)
    assert hand.shape == (2, 5, 3)


def test_result_describes_itself(exp):
    hand = integrate(exp, Curved(), "true", "midpoint", 2)
    assert hand.name == "hand_estimate"
    assert hand.dims == ("trial", "time", "axis")
    assert hand.attrs["units"] == "m"
    assert hand.attrs["seed"] == 7
    assert hand.attrs["diagnostic"] == "true reset"
    assert json.loads(hand.attrs["integration"]) == {
        "reset": "true", "method": "midpoint", "substeps": 2, "initial": None, "path": "time",
    }  # fmt: skip
    np.testing.assert_array_equal(hand.time, exp.time)
    assert "diagnostic" not in integrate(exp, Curved()).attrs


def test_the_order_of_dimensions_does_not_matter(exp):
    turned = exp.transpose("joint", "axis", "time", "trial")
    np.testing.assert_array_equal(integrate(turned, Curved()), integrate(exp, Curved()))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"reset": "sometimes"}, "reset='sometimes'.*'reference', 'posture_map', 'secant', 'true', 'none'"),
        ({"method": "rk4"}, "method='rk4'.*'euler', 'midpoint'"),
        ({"path": "spiral"}, "path='spiral'.*'time', 'star'"),
        ({"substeps": 0}, "substeps=0.*at least 1"),
        ({"substeps": True}, "substeps=True"),
        ({"reset": "posture_map"}, "needs posture_map"),
        ({"reset": "none"}, "needs initial"),
    ],
)
def test_refuses_settings(exp, settings, message):
    with pytest.raises(InvalidConfig, match=message):
        integrate(exp, Curved(), **settings)


def test_refuses_recordings(exp):
    with pytest.raises(InvalidRecording, match="no variable 'true_hand_image'"):
        integrate(exp.drop_vars("true_hand_image"), Curved(), "true")
    with pytest.raises(InvalidRecording, match="no variable 'at_reference'"):
        integrate(exp.drop_vars("at_reference"), Curved())
    for empty in (exp.isel(time=slice(0)), exp.isel(trial=slice(0)), exp.assign(q=exp.q * np.nan)):
        with pytest.raises(InvalidRecording, match="no samples"):
            integrate(empty, Curved())
    # Types are refused before, where they are checked at run time.
    with pytest.raises((InvalidRecording, TypeError), match=r"xarray\.(core\.dataset\.)?Dataset"):
        integrate({"q": 1}, Curved())
    with pytest.raises(InvalidRecording, match="dimensions"):
        integrate(exp.rename(joint="joints"), Curved())
    with pytest.raises(InvalidRecording, match="has no joint"):
        integrate(exp.isel(joint=[]), Curved())
    sized = Curved()
    sized.m = M
    with pytest.raises(InvalidRecording, match=r"'reference_image' has shape \(0,\); give \(2,\)"):
        integrate(exp.isel(axis=[]), sized)
    wide = exp.assign_coords(time=(("other", "time"), np.zeros((2, exp.sizes["time"]))))
    with pytest.raises(InvalidRecording, match="coordinate 'time' has dimensions"):
        integrate(wide, Curved())


def test_refuses_arrays(exp):
    with pytest.raises(InvalidArray, match=r"initial has shape \(3,\); give \(2,\) or \(3, 2\)"):
        integrate(exp, Curved(), initial=np.zeros(3))
    with pytest.raises(InvalidArray, match="initial holds bool"):
        integrate(exp, Curved(), initial=np.zeros(2, bool))
    with pytest.raises(InvalidArray, match=r"learned\.displacement has shape"):
        integrate(exp, Constant(np.ones((3, P))))
    with pytest.raises(InvalidArray, match="posture_map has shape"):
        integrate(exp, Curved(), "posture_map", posture_map=lambda q: q)


# A reset of one's own, and none at all -------------------------------------------------------------------------------


def test_a_function_resets_by_what_is_felt_and_sees_no_truth(exp):
    given = []

    def by_touch(felt):
        given.append(felt)
        return np.stack([felt.touched.values[:, 0], felt.q.values.sum(-1)], axis=-1)

    touched = np.arange(120).reshape(3, 40, 1)
    exp = exp.assign(touched=(("trial", "time", "contact"), touched)).assign_attrs(true_place=1.0)
    exp.q.attrs["true_place"] = 1.0
    hand = integrate(exp, Curved(), by_touch)
    (felt,) = given
    at = exp.at_reference.values
    assert felt.sizes["sample"] == at.sum()
    assert felt.q.dims == ("sample", "joint")
    assert not [name for name in (*felt.variables, *felt.attrs, *felt.q.attrs) if str(name).startswith("true_")]
    np.testing.assert_array_equal(hand.values[at][:, 0], touched[..., 0][at])
    np.testing.assert_array_equal(hand.values[at][:, 1], exp.q.values[at].sum(-1))
    # F of the posture alone is such a function.
    mapped = integrate(exp, Curved(), lambda felt: image(felt.q.values))
    np.testing.assert_array_equal(mapped, integrate(exp, Curved(), "posture_map", posture_map=image))
    assert json.loads(hand.attrs["integration"])["reset"] == "by_touch"
    with pytest.raises(InvalidArray, match="the value of reset has shape"):
        integrate(exp, Curved(), lambda felt: felt.q.values)


def test_where_nothing_tells_where_to_begin_it_is_said(exp):
    nowhere = exp.assign(at_reference=exp.at_reference & False)
    with pytest.raises(InvalidRecording, match="the estimate begins nowhere; give initial="):
        integrate(nowhere, Curved())
    with pytest.raises(InvalidRecording, match="give reset='none' and initial="):
        integrate(exp.drop_vars("at_reference"), Curved())
    one = exp.at_reference.copy(deep=True)
    one.values[:2] = False
    with pytest.warns(DataWarning, match="in 2 of 3 trials the hand never rests at the reference"):
        hand = integrate(exp.assign(at_reference=one), Curved())
    np.testing.assert_array_equal(np.isfinite(hand).any(("time", "axis")), [False, False, True])
    assert np.isfinite(integrate(nowhere, Curved(), initial=INITIAL)).any()


def test_the_unit_is_that_of_the_hand_image(exp):
    pixels = exp.reference_image.assign_attrs(units="px")
    assert integrate(exp.assign(reference_image=pixels), Curved()).attrs["units"] == "px"
    learned = ConstantJacobian(torch.ones(M, P, dtype=torch.float64), unit="mm")
    bare = exp.drop_vars("reference_image")
    assert integrate(bare, learned, "none", initial=INITIAL).attrs["units"] == "mm"


def test_whole_numbers_are_numbers(exp):
    np.testing.assert_array_equal(
        integrate(exp, Curved(), initial=[1, 2]), integrate(exp, Curved(), initial=[1.0, 2.0])
    )


# Scattered postures --------------------------------------------------------------------------------------------------


@pytest.fixture
def touches():
    rng = np.random.default_rng(5)
    q = rng.uniform(-0.5, 0.5, (1, 50, P))
    q[0, 7] = np.nan
    resting = np.zeros((1, 50), bool)
    resting[0, [11, 30]] = True
    return experience(q, resting).assign_attrs(order="scattered")


def test_a_star_reaches_each_posture_straight_from_one_reference(touches):
    hand = integrate(touches, Exact(), path="star")
    q = touches.q.values[0]
    origin = min((11, 30), key=lambda row: tuple(q[row]))
    expected = touches.reference_image.values + image(q) - image(q[origin])
    np.testing.assert_allclose(hand[0], expected, atol=1e-4)
    np.testing.assert_array_equal(hand[0, origin], touches.reference_image)
    setting = json.loads(hand.attrs["integration"])
    assert (setting["path"], setting["method"], setting["substeps"]) == ("star", "midpoint", 40)
    # Forty steps at midpoints: sixteen hundred times nearer than one.
    coarse = np.nanmax(np.abs(integrate(touches, Exact(), path="star", substeps=1).values[0] - expected))
    assert np.nanmax(np.abs(hand.values[0] - expected)) < 1e-3 * coarse


def test_a_star_is_the_same_however_its_rows_are_ordered(touches):
    hand = integrate(touches, Curved(), path="star")
    # Turned round, the other of both references comes first.
    for order in (np.arange(50)[::-1], np.random.default_rng(0).permutation(50)):
        mixed = integrate(touches.isel(time=order), Curved(), path="star")
        np.testing.assert_allclose(mixed[0], hand[0].values[order], rtol=1e-12)


def test_a_star_begins_at_the_first_sample_where_its_image_is_given(touches):
    hand = integrate(touches, Exact(), "none", initial=INITIAL, path="star")
    q = touches.q.values[0]
    np.testing.assert_allclose(hand[0], INITIAL + image(q) - image(q[0]), atol=1e-4)


def test_a_scattered_recording_has_no_path_in_time(touches):
    with pytest.raises(InvalidRecording, match="give path='star'"):
        integrate(touches, Exact())
    with pytest.raises(InvalidRecording, match="begins nowhere"):
        integrate(touches.assign(at_reference=touches.at_reference & False), Exact(), path="star")


def test_posture_to_image_learns_from_seen_samples_alone():
    rng = np.random.default_rng(0)
    q = rng.normal(size=(2, 200, P))
    truth = np.stack([1 + q[..., 0] * q[..., 1], q[..., 2] ** 2 - q[..., 0]], axis=-1)
    seen = truth.copy()
    seen[1, 100:] = np.nan
    spoilt = q.copy()
    spoilt[0, :5] = np.nan
    exp = experience(spoilt, hand_image=(("trial", "time", "axis"), seen))
    F = PostureToImage.fit(exp, ridge=0.0)
    np.testing.assert_allclose(F(q[1, 100:]), truth[1, 100:], atol=1e-10)
    assert np.abs(PostureToImage.fit(exp, ridge=10.0).coefficients).sum() < np.abs(F.coefficients).sum()
    shifted = PostureToImage.fit(exp.assign(hand_image=exp.hand_image + 5.0), ridge=10.0)
    np.testing.assert_allclose(shifted(q[0]) - PostureToImage.fit(exp, ridge=10.0)(q[0]), 5.0, atol=1e-10)
    with pytest.raises(InvalidRecording, match="seen in no sample"):
        PostureToImage.fit(exp.assign(hand_image=exp.hand_image * np.nan))
    with pytest.raises(InvalidConfig, match="degree"):
        PostureToImage.fit(exp, degree=0)
    with pytest.raises(InvalidArray, match=r"\(samples, 3\)"):
        F(q[0, :, :2])
