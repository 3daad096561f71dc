"""Laws of scores without a true Jacobian."""

import numpy as np
import pytest
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording
from bodyimage_kin.estimators import edges, pairs

RNG = np.random.default_rng(0)
MIX = RNG.normal(size=(2, 3))


def image(q):
    """A smooth image of three joints."""
    return np.stack([np.sin(q @ MIX[0]), q @ MIX[1] + 0.5 * q[..., 0] ** 2], -1)


def jacobian(q):
    first = np.cos(q @ MIX[0])[..., None] * MIX[0]
    second = MIX[1] + q[..., :1] * [1.0, 0.0, 0.0]
    return np.stack([first, second], -2)


def scattered(q, seen, **more):
    return xr.Dataset(
        {
            "q": (("trial", "time", "joint"), q[None]),
            "hand_image": (("trial", "time", "axis"), seen[None], {"units": "px"}),
            "taxel": (("trial", "time"), np.full((1, len(q)), -1)),
            "at_reference": (("trial", "time"), np.zeros((1, len(q)), dtype=bool)),
            "reference_image": (("axis",), np.zeros(seen.shape[1])),
            **{name: (("trial", "time"), values[None]) for name, values in more.items()},
        },
        attrs={"order": "scattered"},
    )


class Field:
    """The true Jacobian as one that was learned."""

    p, m = 3, 2

    def displacement(self, q, dq):
        raise AssertionError("pairs are predicted by the integral of the Jacobian")

    def jacobian(self, q):
        return torch.from_numpy(jacobian(np.asarray(q)))


# Errors on pairs and images -------------------------------------------------------------------------------------------


def test_the_true_jacobian_integrates_to_what_is_observed_however_far():
    start, end = RNG.uniform(-1, 1, (2, 50, 3))
    along = metrics.displacements_along(jacobian, start, end, 2)
    found = metrics.pair_error(along, image(end) - image(start))
    assert found.relative < 1e-12
    # Euler is not enough: the pairs are far apart.
    euler = np.einsum("nmp,np->nm", jacobian(start), end - start)
    assert metrics.pair_error(euler, image(end) - image(start)).relative > 0.2


@pytest.mark.parametrize("order", ["scattered", "stream"])
def test_pairs_of_any_recording_begin_where_they_begin(order):
    q = RNG.uniform(-1, 1, (60, 3)) if order == "scattered" else np.cumsum(RNG.normal(0, 0.1, (60, 3)), axis=0)
    exp = scattered(q, image(q)).assign_attrs(order=order)
    hidden = pairs(exp)
    predicted = metrics.predicted_pairs(Field(), hidden)
    np.testing.assert_allclose(predicted, hidden.dr, atol=1e-12)


def test_pair_error_by_hand():
    predicted = [[3.0, 0.0], [0.0, 0.0], [np.nan, 1.0]]
    observed = [[0.0, 4.0], [0.0, 12.0], [1.0, 1.0]]
    found = metrics.pair_error(predicted, observed)
    assert found.error == pytest.approx(np.sqrt((25 + 144) / 2))
    assert found.size == pytest.approx(np.sqrt((16 + 144) / 2))
    assert found.relative == pytest.approx(np.sqrt(169 / 160))
    assert (found.corrected, found.relative_corrected) == pytest.approx((found.error, found.relative))
    assert (found.floor, found.count) == (0, 2)
    assert metrics.pair_error(np.zeros((4, 2)), RNG.normal(size=(4, 2))).relative == pytest.approx(1)


def test_image_error_by_hand():
    observed = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]])
    found = metrics.image_error(observed + np.array([0.0, 1.0]), observed, noise=0.6)
    assert (found.error, found.size) == pytest.approx((1, np.sqrt(8 / 3)))
    assert found.corrected == pytest.approx(0.8)
    assert found.relative_corrected == pytest.approx(0.8 / np.sqrt(8 / 3 - 0.36))
    mean = np.broadcast_to(observed.mean(0), observed.shape)
    assert metrics.image_error(mean, observed).relative == pytest.approx(1)


def test_the_floor_is_what_noise_alone_makes_and_is_taken_off_in_squares():
    sd, count = 0.01, 4000
    q = RNG.uniform(-1, 1, (count, 3))
    ends = edges(q)
    seen = image(q) + RNG.normal(0, sd, (count, 2))
    noise = metrics.stated_noise(2, sd)
    true = image(q)[ends[:, 1]] - image(q)[ends[:, 0]]
    observed = seen[ends[:, 1]] - seen[ends[:, 0]]
    perfect = metrics.pair_error(true, observed, noise)
    assert perfect.error == pytest.approx(perfect.floor, rel=0.03)
    assert perfect.corrected < 0.3 * perfect.error
    # What a model gets wrong by itself is found below the noise.
    wrong = metrics.pair_error(true * 0.7, observed, noise)
    clean = metrics.pair_error(true * 0.7, true)
    assert wrong.error > 1.2 * clean.error
    assert (wrong.corrected, wrong.relative_corrected) == pytest.approx((clean.error, 0.3), rel=0.05)
    assert metrics.image_error(image(q), seen, noise).error == pytest.approx(noise, rel=0.03)


def test_a_corrected_error_is_never_below_zero_nor_invented():
    rows = RNG.normal(size=(30, 2))
    found = metrics.pair_error(rows, rows + 1e-3, noise=0.1)
    assert (found.corrected, found.relative_corrected) == (0, 0)
    assert np.isnan(metrics.pair_error(0 * rows, rows, noise=100.0).relative_corrected), "all that is seen is noise"
    empty = metrics.pair_error(np.nan * rows, rows, noise=0.1)
    assert np.isnan([empty.error, empty.size, empty.relative, empty.corrected, empty.relative_corrected]).all()
    assert empty.count == 0


def test_noise_is_found_from_repeats_and_is_not_biased_by_pairs():
    sd = 0.3
    for times in (2, 3, 20):
        count = 6000 // times
        repeat = np.repeat(np.arange(count), times)
        seen = RNG.normal(size=(count, 2))[repeat] + RNG.normal(0, sd, (len(repeat), 2))
        once = np.full(500, -1)
        seen, repeat = np.concatenate([seen, RNG.normal(size=(500, 2))]), np.concatenate([repeat, once])
        order = RNG.permutation(len(seen))
        seen[order[:50]] = np.nan
        found = metrics.noise_floor(seen[order], repeat[order])
        assert found == pytest.approx(np.sqrt(2) * sd, rel=0.05)
    assert metrics.noise_floor([[0.0], [2.0], [5.0]], [4, 4, 9]) == pytest.approx(np.sqrt(2))
    assert np.isnan(metrics.noise_floor(np.zeros((3, 2)), [-1, -1, -1]))
    assert np.isnan(metrics.noise_floor(np.zeros((3, 2)), [0, 1, 2]))


def test_stated_noise_of_encoders_goes_through_the_jacobian():
    sd, encoder = 0.01, 0.02
    q = RNG.uniform(-1, 1, (20_000, 3))
    J = jacobian(q)
    noisy = np.einsum("nmp,np->nm", J, RNG.normal(0, encoder, q.shape)) + RNG.normal(0, sd, (len(q), 2))
    expected = np.sqrt((noisy**2).sum(-1).mean())
    assert metrics.stated_noise(2, sd, encoder, J) == pytest.approx(expected, rel=0.02)
    for m in (1, 2, 3, 4):
        assert metrics.stated_noise(m, sd) == pytest.approx(np.sqrt(m) * sd, rel=1e-12)


# Directions -----------------------------------------------------------------------------------------------------------


def test_postures_of_a_plane_move_two_directions_of_five():
    plane = np.linalg.qr(RNG.normal(size=(5, 2)))[0].T
    flat = RNG.uniform(-1, 1, (300, 2)) @ plane
    found = metrics.local_spectrum(flat + 1e-4 * RNG.normal(size=(300, 5)))
    np.testing.assert_array_equal(found.moved.sum(1), 2)
    assert found.share == pytest.approx(0.4)
    # The directions are those of the plane, joints over their spread.
    inside = np.linalg.qr((plane / found.spread).T)[0]
    for directions in found.directions[:20, :2]:
        np.testing.assert_allclose(directions @ inside @ inside.T, directions, atol=0.02)
    assert metrics.local_spectrum(RNG.uniform(-1, 1, (300, 5))).share > 0.99


def test_a_curved_surface_is_seen_to_move_few_directions_locally():
    t = RNG.uniform(-1, 1, (3000, 2))
    bent = np.stack([t[:, 0], t[:, 1], np.sin(2 * t[:, 0]), np.cos(2 * t[:, 1])], 1)
    whole = np.linalg.svd((bent - bent.mean(0)) / bent.std(0), compute_uv=False)
    assert (whole > 0.1 * whole[0]).all(), "as a whole it moves in every direction"
    assert metrics.local_spectrum(bent).share < 0.6


def test_spectrum_by_hand():
    # Two neighbours of the first: one step along each joint, of half and twice; a joint that rests.
    q = np.array([[0.0, 0.0, 7.0], [0.5, 0.0, 7.0], [0.0, 2.0, 7.0], [8.0, 8.0, 7.0]])
    found = metrics.local_spectrum(q, neighbours=2)
    spread = q.std(0)
    assert found.spread == pytest.approx([spread[0], spread[1], 1.0])
    expected = sorted([0.5 / spread[0] / np.sqrt(2), 2.0 / spread[1] / np.sqrt(2)], reverse=True)
    np.testing.assert_allclose(found.values[0], [*expected, 0])
    assert list(found.moved[0]) == [True, True, False]
    assert list(metrics.local_spectrum(q, 2, cut=0.9).moved[0]) == [True, False, False]


def test_units_of_joints_do_not_count():
    q = RNG.normal(size=(200, 4)) * [1, 1, 1, 1e-4]
    one, other = metrics.local_spectrum(q), metrics.local_spectrum(q * [1e3, 1, 1e-3, 1e4])
    np.testing.assert_allclose(one.values, other.values, rtol=1e-9)


def test_repeats_of_a_posture_are_no_neighbours():
    q = RNG.uniform(-1, 1, (100, 3))
    once = metrics.local_spectrum(q)
    twice = metrics.local_spectrum(np.concatenate([q, q, q]))
    np.testing.assert_allclose(twice.values, np.tile(once.values, (3, 1)), rtol=1e-9)
    noisy = np.repeat(q, 20, axis=0) + RNG.uniform(-1e-3, 1e-3, (2000, 3))
    # Each posture felt twenty times: without a word of the noise its own repeats are all the neighbours there are.
    told = metrics.local_spectrum(noisy, noise=1e-3)
    assert np.median(told.values[:, 0]) > 50 * np.median(metrics.local_spectrum(noisy).values[:, 0])
    np.testing.assert_allclose(np.median(told.values), np.median(once.values), rtol=0.05)


def test_an_error_along_directions_that_never_moved_is_none_that_was_observed():
    plane = np.linalg.qr(RNG.normal(size=(4, 2)))[0].T
    q = RNG.uniform(-1, 1, (200, 2)) @ plane
    spectrum = metrics.local_spectrum(q)
    J = RNG.normal(size=(200, 2, 4))
    beside = np.eye(4) - plane.T @ plane
    restricted = [
        metrics.pooled_relative_error(spectrum.restrict(J), spectrum.restrict(J + E))
        for E in (5 * J @ beside, 0.3 * J @ plane.T @ plane)
    ]
    assert restricted[0] < 1e-9
    assert restricted[1] == pytest.approx(0.3)
    assert metrics.pooled_relative_error(J, J + 5 * J @ beside) > 2


def test_a_learner_that_saw_a_plane_is_right_about_pairs_and_wrong_about_the_rest(body):
    rng = np.random.default_rng(1)
    centre = bk.probes.JointSpace(1).postures(body, xr.Dataset()).numpy()
    plane = np.linalg.qr(rng.normal(size=(body.p, 2)))[0].T
    q = centre + 0.1 * rng.uniform(-1, 1, (250, 2)) @ plane
    exp = scattered(q, body.hand_image(q, on_invisible="nan").numpy())
    fold = metrics.hold_out_folds(exp, 4)[0]
    with pytest.warns(bk.errors.DataWarning, match="hardly move along"):
        learned = bk.estimators.GaussianProcess().fit(fold.seen)
    on_pairs = metrics.pair_error(metrics.predicted_pairs(learned, fold.hidden), fold.hidden.dr)
    spectrum = metrics.local_spectrum(q)
    J, Jh = body.hand_image_jacobian(q).numpy(), learned.jacobian(q).numpy()
    assert on_pairs.relative < 0.02
    assert spectrum.share == pytest.approx(2 / body.p)
    assert metrics.pooled_relative_error(spectrum.restrict(J), spectrum.restrict(Jh)) < 0.05
    assert metrics.pooled_relative_error(J, Jh) > 0.3


# Folds ----------------------------------------------------------------------------------------------------------------


def test_blocks_are_hidden_whole_and_no_edge_crosses():
    q = RNG.uniform(-1, 1, (80, 3))
    block = np.repeat([7, 3, 3, 9], 20)
    exp = scattered(q, image(q), block=block)
    found = metrics.hold_out_folds(exp, 5)
    assert len(found) == 3, "three blocks, however many folds are asked for"
    rows = {tuple(row): number for row, number in zip(q.round(9).tolist(), block, strict=True)}
    for one in found:
        hidden = np.isnan(one.seen["hand_image"].values[0]).any(-1)
        (number,) = set(block[hidden])
        np.testing.assert_array_equal(hidden, block == number)
        ends = np.concatenate([one.hidden.q - one.hidden.dq / 2, one.hidden.q + one.hidden.dq / 2])
        assert {rows[tuple(row)] for row in ends.round(9).tolist()} == {number}


def test_folds_without_blocks_are_clusters_and_do_not_depend_on_the_order_of_rows():
    q = RNG.uniform(-1, 1, (60, 3))
    order = RNG.permutation(60)
    one, other = (metrics.hold_out_folds(scattered(a, image(a)), 3) for a in (q, q[order]))
    for first, second in zip(one, other, strict=True):
        hidden, shuffled = (np.isnan(part.seen["hand_image"].values[0]).any(-1) for part in (first, second))
        np.testing.assert_array_equal(hidden[order], shuffled)
        assert torch.equal(first.hidden.q, second.hidden.q)


def test_folds_that_cannot_be_are_refused():
    q = RNG.uniform(-1, 1, (10, 3))
    with pytest.raises(InvalidRecording, match="single block"):
        metrics.hold_out_folds(scattered(q, image(q), block=np.zeros(10, int)))
    with pytest.raises(InvalidRecording, match=r"fold \d of 10 cannot be held out"):
        metrics.hold_out_folds(scattered(q, image(q)), 10)
    with pytest.raises(InvalidConfig, match="folds=1"):
        metrics.hold_out_folds(scattered(q, image(q)), 1)


def test_a_scattered_recording_has_the_excitation_of_its_edges():
    q = RNG.uniform(-1, 1, (200, 3)) * [1, 1, 1e-3]
    exp, use = scattered(q, image(q)), RNG.normal(size=(100, 3))
    ends = edges(q)
    np.testing.assert_array_equal(metrics.motion_metric(exp), metrics.motion_metric(q[ends[:, 1]] - q[ends[:, 0]]))
    order = RNG.permutation(200)
    found = metrics.excitation(exp, use).eigenvalues
    shuffled = metrics.excitation(scattered(q[order], image(q[order])), use).eigenvalues
    np.testing.assert_allclose(found, shuffled, rtol=1e-9)
    # In the order of its rows, postures are as far apart as can be.
    assert found[0] < 0.3 * metrics.excitation(np.diff(q, axis=0), use).eigenvalues[0]


@pytest.mark.parametrize(
    ("ask", "error", "message"),
    [
        (lambda: metrics.pair_error(np.zeros((3, 2)), np.zeros((3, 3))), InvalidArray, "predicted has shape"),
        (lambda: metrics.pair_error(np.zeros((3, 2)), np.zeros((3, 2)), -1.0), InvalidConfig, "noise=-1.0"),
        (lambda: metrics.noise_floor(np.zeros((3, 2)), [0.0, 0.0, 1.0]), InvalidArray, "whole numbers"),
        (lambda: metrics.noise_floor(np.zeros((3, 2)), [0, 1]), InvalidArray, r"repeat \(2,\)"),
        (lambda: metrics.stated_noise(2, 0.1, 0.1), InvalidArray, "jacobian"),
        (lambda: metrics.local_spectrum(np.full((5, 2), np.nan)), InvalidArray, "all finite"),
        (lambda: metrics.local_spectrum(np.ones((5, 2))), InvalidArray, "do not differ"),
        (lambda: metrics.local_spectrum(np.eye(3), cut=0.0), InvalidConfig, "cut=0.0"),
        (lambda: metrics.local_spectrum(np.eye(3)).restrict(np.ones((2, 2, 3))), InvalidArray, "one a posture"),
        (lambda: metrics.displacements_along(jacobian, np.ones(3), np.ones(3), 2), InvalidArray, r"\(edges, p\)"),
    ],
)
def test_bad_inputs_are_named(ask, error, message):
    with pytest.raises(error, match=message):
        ask()
