"""Maps and the posture's image held against their formulas, written out step by step in plain Python."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

from bodyimage_kin.body_image import BodyImage, PostureSOM, PostureToImage

STEPS, GRID, POSTURE_GRID = 40, (3, 4), (2, 3)


def recording(seed: int = 0) -> tuple[xr.Dataset, np.ndarray]:
    """Touches of a small skin, some of nothing, and the hand images to learn from."""
    rng = np.random.default_rng(seed)
    q, touched, hand = rng.normal(size=(1, STEPS, 2)), rng.integers(-1, 12, (1, STEPS, 1)), rng.random((1, STEPS, 2))
    sample = ("trial", "time")
    return xr.Dataset({"q": ((*sample, "joint"), q), "touched": ((*sample, "contact"), touched)}), hand


def walked(
    first: np.ndarray, winners: np.ndarray, targets: np.ndarray, rates: np.ndarray, widths: np.ndarray, kernel: str
) -> np.ndarray:
    """``w_i += rate h(d_ic) (target - w_i)`` at every step with a winner, unit by unit."""
    weights = first.copy()
    rows, columns = weights.shape[:2]
    for winner, target, rate, width in zip(winners, targets, rates, widths, strict=True):
        for row in range(rows if winner >= 0 else 0):
            for column in range(columns):
                squared = (row - winner // columns) ** 2 + (column - winner % columns) ** 2
                pull = math.exp(-(squared if kernel == "squared" else math.sqrt(squared)) / width)
                weights[row, column] += rate * pull * (target - weights[row, column])
    return weights


@pytest.mark.parametrize("kernel", ["squared", "plain"])
def test_both_maps_learn_and_narrow_as_their_formulas_say(kernel: str) -> None:
    exp, hand = recording()
    som = PostureSOM(np.random.default_rng(1).normal(size=(*POSTURE_GRID, 2)), np.array([1.0, 2.0]))
    body = BodyImage.learn(
        exp, hand, skin=GRID, posture_grid=POSTURE_GRID, posture_som=som, kernel=kernel, gamma=4.0, gamma_posture=2.0,
        gamma_final=0.5, alpha="geometric", image_range=[[0.0, 1.0], [0.0, 1.0]], snapshots=(0, 10),
    )  # fmt: skip
    share = np.arange(STEPS) / (STEPS - 1)
    rates, narrowing = 0.3 * (0.02 / 0.3) ** share, (0.5 / 4.0) ** share
    touched = exp["touched"].values[0, :, 0]
    postures = np.where(touched >= 0, som.winners(exp["q"].values[0]), -1)
    learned = {
        "tactile_maps": (touched, 4.0 * narrowing),
        "posture_maps": (postures, 2.0 * narrowing),
    }
    for name, (winners, widths) in learned.items():
        first, tenth, last = body.history[name]
        for steps, found in ((10, tenth), (STEPS, last)):
            here = slice(0, steps)
            expected = walked(first, winners[here], hand[0, here], rates[here], widths[here], kernel)
            np.testing.assert_allclose(found, expected, rtol=1e-12, err_msg=name)


def test_the_image_of_a_posture_minimises_the_mean_error_and_the_penalty() -> None:
    rng = np.random.default_rng(2)
    q = rng.normal(size=(1, 60, 2)) * [0.3, 2.0] + [1.0, -4.0]
    image = np.stack([np.sin(q[..., 0]) + q[..., 1], q[..., 0] * q[..., 1]], axis=-1)
    dims = ("trial", "time")
    exp = xr.Dataset({"q": ((*dims, "joint"), q), "hand_image": ((*dims, "axis"), image)})
    penalty = 0.3
    z = (q[0] - q[0].mean(0)) / q[0].std(0)
    features = np.stack([z[:, 0], z[:, 1], z[:, 0] ** 2, z[:, 0] * z[:, 1], z[:, 1] ** 2], axis=1)
    centred, wanted = features - features.mean(0), image[0] - image[0].mean(0)
    # The gradient of mean |wanted - centred c|^2 + penalty |c|^2 is zero.
    gram = centred.T @ centred / 60 + penalty * np.eye(5)
    coefficients = np.linalg.solve(gram, centred.T @ wanted / 60)
    learned = PostureToImage.fit(exp, degree=2, ridge=penalty)
    np.testing.assert_allclose(learned(q[0]), centred @ coefficients + image[0].mean(0), rtol=1e-10)
    # So the penalty means the same however long the recording is.
    twice = PostureToImage.fit(xr.concat([exp, exp], "time"), degree=2, ridge=penalty)
    np.testing.assert_allclose(twice.coefficients, learned.coefficients, rtol=1e-10)
