"""Laws of Gaussian processes and of the posterior of their derivative."""

import numpy as np
import pytest
import torch
from experiences import taught

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidRecording
from bodyimage_kin.estimators import GaussianProcess

KERNELS = [GaussianProcess("trigonometric"), GaussianProcess("radial")]


@pytest.fixture(scope="module", params=KERNELS, ids=lambda spec: spec.kernel)
def learned(request):
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (80, 2))
    image = 0.05 * np.stack([np.sin(q[:, 0]) + np.sin(q[:, 1]) / 2, np.cos(q[:, 1]) * np.sin(q[:, 0])], 1)
    image += 1e-3 * rng.standard_normal(image.shape)
    exp = taught(np.diff(q, axis=0), np.diff(image, axis=0))
    return request.param.fit(exp.assign(q=exp.q + q[0], hand_image=exp.hand_image + image[0]))


INSIDE = torch.tensor([[0.0, 0.0], [0.5, -0.3], [-0.6, 0.4]], dtype=torch.float64)


def spread(learned, q):
    """Standard deviation of each entry."""
    found = learned.covariance(q).diagonal(dim1=-2, dim2=-1).sqrt()
    return found.reshape(*found.shape[:-1], learned.m, learned.p)


def truth(q):
    x, y = q[:, 0], q[:, 1]
    rows = [torch.stack([torch.cos(x), torch.cos(y) / 2], -1)]
    rows.append(torch.stack([torch.cos(y) * torch.cos(x), -torch.sin(y) * torch.sin(x)], -1))
    return 0.05 * torch.stack(rows, -2)


def test_the_truth_is_within_what_the_posterior_allows(learned):
    away = (learned.jacobian(INSIDE) - truth(INSIDE)) / spread(learned, INSIDE)
    assert away.abs().max() < 4.0
    assert (learned.jacobian(INSIDE) - truth(INSIDE)).abs().max() < 5e-3


def test_doubt_grows_away_from_what_was_seen(learned):
    home, far = spread(learned, [0.0, 0.0]), spread(learned, [2.5, 2.5])
    assert (far > 2.0 * home).all()


def test_at_most_so_many_samples_are_used(circle):
    assert len(GaussianProcess("radial", most=25).fit(bk.experience(circle)).q) == 25


def test_an_image_that_stands_still_has_no_scale(circle):
    exp = bk.experience(circle)
    still = exp.assign(hand_image=exp.hand_image * 0.0)
    with pytest.raises(InvalidRecording, match="never moves"):
        GaussianProcess().fit(still)


def test_kernels_are_known():
    with pytest.raises(InvalidConfig, match="one of 'trigonometric', 'radial'"):
        GaussianProcess("linear")
