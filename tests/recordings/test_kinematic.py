"""Laws of recordings without dynamics: where the hand goes, what is felt and what is true."""

import dataclasses
import json

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import DataWarning, InvalidConfig, UnknownName, Unreachable
from bodyimage_kin.recordings import check, first_taxel, schema
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.recordings.paths import Timeline

SHORT = {"circle": Circle(turns=0.25), "face_tour": FaceTour(("nose", "mouth")), "random_touch": RandomTouch(3.0)}
KINDS = tuple(SHORT)


def simulate(body, kind, seed=0, trials=1, noise=None, **settings):
    return bk.simulate(body, dataclasses.replace(SHORT[kind], **settings), seed, trials, noise=noise)


def in_skin(body, rec, trial=0):
    """The hand's centre in the skin's link, from true postures."""
    q = rec.true_q.values[trial]
    return body.hand_in_skin(q[np.isfinite(q).all(1)]).numpy()


def speeds(centres, sampling=0.1):
    return np.linalg.norm(np.diff(centres, axis=0), axis=1) / sampling


# Paths ----------------------------------------------------------------------------------------------------------------


def test_the_circle_is_a_circle_in_front_of_the_face(body, circle):
    centres = in_skin(body, circle)
    patch = body.skin.layout
    middle = body.touch_centres([220], 0.03)[0].numpy()
    away = centres - middle
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.05, atol=1e-9)
    np.testing.assert_allclose(away @ patch.forward, 0.0, atol=1e-9)
    # 3 cm in front of touching at the middle: hand radius and distance beyond the surface.
    np.testing.assert_allclose(middle - body.skin.link_positions[220], 0.05 * patch.forward, atol=1e-12)


def test_the_circle_goes_round_both_ways_at_constant_speed(body, circle):
    centres = in_skin(body, circle)
    away = centres - body.touch_centres([220], 0.03)[0].numpy()
    angle = np.unwrap(np.arctan2(away @ body.skin.down, away @ body.skin.right))
    steps = np.diff(angle)
    turn = int(np.argmax(angle))
    duration = 2 * np.pi * 0.05 / 0.05
    assert circle.sizes["time"] == int(2 * duration / 0.1) + 1
    # 0.05 m/s on a radius of 0.05 m is 1 rad/s, clockwise as the eye sees it and then back.
    np.testing.assert_allclose(steps[: turn - 1], 0.1, atol=1e-7)
    np.testing.assert_allclose(steps[turn + 1 :], -0.1, atol=1e-7)
    assert angle.max() - angle[0] == pytest.approx(2 * np.pi, abs=0.1)
    assert angle[-1] - angle[0] == pytest.approx(0.0, abs=0.1)
    image = circle.true_hand_image.values[0, :10] - circle.true_hand_image.values[0].mean(0)
    (x, y), (dx, dy) = image[:-1].T, np.diff(image, axis=0).T
    assert (x * dy - y * dx > 0).all()


def test_each_circle_begins_at_a_phase_of_its_own(body):
    rec = simulate(body, "circle", trials=6)
    away = rec.true_hand_image.values[:, 0] - rec.true_hand_image.values.mean(axis=(0, 1))
    phases = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    assert np.diff(phases).min() > 1e-3
    assert np.ptp(phases) > 1.0


def test_the_tour_visits_the_landmarks_in_order(body, tour):
    taxels = first_taxel(tour, truth=True)[0]
    assert (taxels >= 0).all()
    order = [body.skin.landmarks[name] for name in bk.motions.TOUR]
    assert order == [body.skin.landmarks[n] for n in ("mouth", "nose", "right_eye", "left_eye", "nose")]
    targets = body.touch_centres(order).numpy()
    centres = in_skin(body, tour)
    visits = [int(np.argmin(np.linalg.norm(centres - targets[0], axis=1)))]
    for target in targets[1:]:
        rest = np.linalg.norm(centres[visits[-1] :] - target, axis=1)
        visits.append(visits[-1] + int(np.argmax(rest < 1.5e-3)))
        assert rest.min() < 1.5e-3
    assert visits[0] == 0
    assert visits == sorted(set(visits))
    assert not tour.at_reference.values.any()


def test_a_stroke_of_the_tour_has_a_minimum_jerk_profile(body):
    rec = bk.simulate(body, FaceTour(["left_eye", "right_eye"], sampling=0.02), dynamics=False)
    steps = speeds(in_skin(body, rec), 0.02) * 0.02
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    # 0.05 m/s in the mean, slow at both ends: 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985).
    target = body.touch_centres([body.skin.landmarks[name] for name in ("left_eye", "right_eye")])
    assert gone[-1] > float((target[1] - target[0]).norm())
    s = rec.time.values / (gone[-1] / 0.05)
    np.testing.assert_allclose(gone / gone[-1], 10 * s**3 - 15 * s**4 + 6 * s**5, atol=5e-3)


def test_random_touches_slide_at_constant_speed_and_rest_at_the_reference(body, touch):
    centres = in_skin(body, touch)
    path = speeds(centres)
    resting = touch.at_reference.values[0]
    assert path.max() < 0.05 * (1 + 1e-3)
    assert np.median(path) == pytest.approx(0.05, rel=1e-3)
    np.testing.assert_allclose(
        centres[resting], body.touch_centres([body.skin.reference]).numpy()[[0] * resting.sum()], atol=2e-9
    )
    np.testing.assert_array_equal(first_taxel(touch, truth=True)[0][resting], body.skin.reference)
    # The hand starts with a rest of 0.5 s and sets out to return at the first target after every 10 s.
    starts = touch.time.values[np.flatnonzero(np.diff(resting.astype(int), prepend=0) == 1)]
    assert starts[0] == 0.0
    assert len(starts) == 3
    assert (np.abs(starts[1:] - [10.0, 20.0]) < 3.5).all()
    assert (starts[1:] > [10.0, 20.0]).all()
    lengths = np.diff(np.flatnonzero(np.diff(np.pad(resting, 1).astype(int))))[::2]
    assert set(lengths.tolist()) <= {5, 6}
    assert touch.sizes["time"] == 300
    assert (touch.true_touched.values >= 0).all()


def test_targets_are_uniform_over_all_taxels(body, monkeypatch):
    ends = []
    stroke = Timeline.stroke
    monkeypatch.setattr(Timeline, "stroke", lambda self, a, b, *rest: (ends.append(b), stroke(self, a, b, *rest))[1])
    RandomTouch(600.0, reset_interval=None, speed=0.1).path(body, np.random.default_rng(0), 0.1)
    rows, columns = np.divmod(ends, 21)
    assert len(rows) > 500
    for coordinate in (rows, columns):
        assert (coordinate.min(), coordinate.max()) == (0, 20)
        assert coordinate.mean() == pytest.approx(10, abs=0.8)
        assert coordinate.var() == pytest.approx((21**2 - 1) / 12, rel=0.12)


def test_without_resets_the_hand_never_returns(body):
    rec = simulate(body, "random_touch", duration=15.0, reset_interval=None)
    assert rec.at_reference.values[0, :6].all()
    assert not rec.at_reference.values[0, 6:].any()


# What is felt and what is true ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("fixture", ["circle", "tour", "touch"])
def test_the_truth_follows_from_the_true_postures(body, request, fixture):
    rec = request.getfixturevalue(fixture)
    q = rec.true_q.values
    lower, upper = body.felt_robot.lower.numpy(), body.felt_robot.upper.numpy()
    assert (q >= lower).all()
    assert (q <= upper).all()
    # Without noise what is felt is true.
    np.testing.assert_array_equal(rec.q.values, q)
    np.testing.assert_allclose(rec.true_hand_image.values, body.hand_image(q).numpy(), atol=1e-15)
    np.testing.assert_allclose(rec.true_hand_position.values, body.hand_position(q).numpy(), atol=1e-15)
    seen = np.isfinite(rec.hand_image.values).all(-1)
    np.testing.assert_array_equal(seen, body.visible(q).numpy())
    np.testing.assert_array_equal(seen, fixture == "circle")
    np.testing.assert_array_equal(first_taxel(rec, truth=True) >= 0, fixture != "circle")
    reference = body.hand_image(body.touch_postures([body.skin.reference]))[0].numpy()
    np.testing.assert_allclose(rec.reference_image.values, reference, atol=1e-15)
    # Joints move smoothly: a step of 0.1 s is a small one.
    assert np.abs(np.diff(q, axis=1)).max() < 0.3


def test_a_touch_is_silent_with_the_stated_probability(touch):
    felt, true = first_taxel(touch), first_taxel(touch, truth=True)
    silent = felt == -1
    np.testing.assert_array_equal(felt[~silent], true[~silent])
    # 300 samples at 0.2: within four standard deviations.
    assert silent.mean() == pytest.approx(0.2, abs=4 * np.sqrt(0.2 * 0.8 / 300))


@pytest.mark.parametrize(("silence", "share"), [(0.0, 0.0), (1.0, 1.0)])
def test_all_touches_or_none_are_silent(body, silence, share):
    assert (simulate(body, "random_touch", silence=silence).touched.values == -1).mean() == share


def test_attributes_and_coordinates_tell_where_it_comes_from(body, circle):
    assert circle.sizes == {"trial": 1, "time": circle.sizes["time"], "joint": 5, "axis": 2, "space": 3, "contact": 1}
    assert tuple(circle.joint.values) == body.joints
    np.testing.assert_allclose(circle.time.values, 0.1 * np.arange(circle.sizes["time"]), atol=1e-12)
    attributes = circle.attrs
    assert (attributes["motion"], attributes["embodiment"], attributes["sampling"]) == ("Circle", "infant", 0.1)
    assert (attributes["rows"], attributes["columns"]) == (21, 21)
    assert attributes["urdf_sha256"] == body.robot.sha256
    assert attributes["embodiment_sha256"] == body.sha256
    assert {"pin", "torch", "numpy"} <= set(json.loads(attributes["versions"]))
    assert circle.q.attrs["units"] == "rad"
    assert circle.hand_image.attrs["units"] == "m"
    assert circle.touched.dtype.kind == "i"
    assert circle.at_reference.dtype == bool
    assert check(circle) is circle


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(body, kind):
    one, same, other = (simulate(body, kind, seed=seed) for seed in (3, 3, 4))
    assert one.identical(same)
    assert not np.array_equal(one.true_q.values[:, :10], other.true_q.values[:, :10])


@pytest.mark.parametrize("kind", KINDS)
def test_a_trial_is_the_same_however_many_there_are(body, kind):
    one, three = simulate(body, kind, trials=1, seed=5), simulate(body, kind, trials=3, seed=5)
    alone = one.sizes["time"]
    for name in one.data_vars:
        if name != "reference_image":
            np.testing.assert_array_equal(three[name].values[0, :alone], one[name].values[0])
    assert not np.array_equal(three.true_q.values[0, :5], three.true_q.values[1, :5])


def test_shorter_trials_are_padded(body, monkeypatch):
    path, turns = Circle.path, iter([0.5, 0.25])
    monkeypatch.setattr(Circle, "path", lambda self, *rest: path(dataclasses.replace(self, turns=next(turns)), *rest))
    rec = bk.simulate(body, Circle(), trials=2, dynamics=False)
    short = int(2 * 0.25 * 2 * np.pi * 0.05 / 0.05 / 0.1) + 1
    assert rec.sizes["time"] > short
    for name in ("q", "true_q", "hand_image", "true_hand_image", "true_hand_position"):
        assert np.isfinite(rec[name].values[0]).all()
        assert np.isfinite(rec[name].values[1, :short]).all()
        assert np.isnan(rec[name].values[1, short:]).all()
    for name, filling in (("touched", -1), ("true_touched", -1), ("at_reference", False)):
        assert (rec[name].values[1, short:] == filling).all()


@pytest.mark.parametrize("kind", KINDS)
def test_noise_changes_what_is_felt_and_nothing_else(body, kind):
    clean = simulate(body, kind, seed=2)
    noisy = simulate(body, kind, seed=2, noise=bk.Noise(encoder=1e-3, image=2e-4))
    for name in (*schema.TRUE, "touched", "at_reference", "reference_image"):
        np.testing.assert_array_equal(noisy[name].values, clean[name].values)
    assert np.std(noisy.q.values - noisy.true_q.values) == pytest.approx(1e-3, rel=0.2)
    if kind == "circle":
        assert np.std(noisy.hand_image.values - noisy.true_hand_image.values) == pytest.approx(2e-4, rel=0.25)
    only_image = simulate(body, kind, seed=2, noise=bk.Noise(image=2e-4))
    np.testing.assert_array_equal(only_image.hand_image.values, noisy.hand_image.values)
    np.testing.assert_array_equal(only_image.q.values, clean.q.values)


def test_an_experience_has_no_truth(circle):
    exp = bk.experience(circle)
    assert set(exp.data_vars) == {"q", "hand_image", "touched", "at_reference", "reference_image"}
    assert not [name for name in exp.variables if str(name).startswith("true")]
    assert exp.attrs == circle.attrs
    assert bk.experience(exp).identical(exp)
    assert "true_q" in circle


# What is refused ------------------------------------------------------------------------------------------------------


def test_an_unknown_landmark_is_named(body):
    with pytest.raises(UnknownName, match="no landmark 'noes'; did you mean 'nose'"):
        bk.simulate(body, FaceTour(["noes", "mouth"]), dynamics=False)


def test_a_circle_out_of_reach_or_out_of_sight_is_refused(body):
    with pytest.raises(Unreachable):
        bk.simulate(body, Circle(radius=0.3, turns=0.25), dynamics=False)
    with pytest.raises(InvalidConfig, match=r"the eye does not see the hand in .* samples of Circle"):
        bk.simulate(body, Circle(distance=0.0, turns=0.25), dynamics=False)


def test_a_touch_that_is_seen_is_told_and_recorded_as_seen(body):
    near = dataclasses.replace(body.camera.screen, near=0.01)
    sees = dataclasses.replace(body, camera=dataclasses.replace(body.camera, model=near))
    with pytest.warns(DataWarning, match=r"the eye sees the hand in \d+ of \d+ samples while it touches"):
        touch = simulate(sees, "random_touch")
    seen = np.isfinite(touch.hand_image.values).all(-1)
    np.testing.assert_array_equal(seen, sees.visible(touch.true_q.values).numpy())
    assert seen.any()
    # On request it counts as unseen, and nothing else changes; a circle, which touches nothing, stays seen.
    motion = RandomTouch(duration=4.0)
    with pytest.warns(DataWarning, match="of none with touch_seen=False"):
        told = bk.simulate(sees, motion, dynamics=False)
    blind = bk.simulate(sees, motion, dynamics=False, touch_seen=False)
    touching = (blind["true_touched"].values >= 0).any(-1)
    assert np.isnan(blind["hand_image"].values[touching]).all()
    for name in set(told.data_vars) - {"hand_image"}:
        assert blind[name].identical(told[name]), name
    circle = [bk.simulate(sees, Circle(turns=0.1), dynamics=False, touch_seen=seen) for seen in (True, False)]
    np.testing.assert_array_equal(circle[0]["hand_image"], circle[1]["hand_image"])


def test_the_state_of_the_global_generators_is_left_alone(body):
    torch_state, numpy_state = torch.get_rng_state(), str(np.random.get_state(legacy=False))  # noqa: NPY002
    simulate(body, "random_touch")
    assert str(np.random.get_state(legacy=False)) == numpy_state  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), torch_state)


def test_the_pull_to_rest_is_a_rate_and_never_goes_past_it(body):
    """However strong: what is left of the way falls by ``exp(-rest_pull sampling)`` a sample."""
    strong = bk.simulate(body, bk.motions.Circle(turns=0.1, rest_pull=1e6), dynamics=False, seed=4)
    stronger = bk.simulate(body, bk.motions.Circle(turns=0.1, rest_pull=1e9), dynamics=False, seed=4)
    np.testing.assert_allclose(strong.true_q, stronger.true_q, atol=1e-9)
