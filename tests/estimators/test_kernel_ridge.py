"""Laws of kernel ridge regression: exact derivatives, what each kernel can say, and settings that are chosen."""

import numpy as np
import pytest
import torch
from experiences import scattered

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import KernelRidge
from bodyimage_kin.estimators.kernel_ridge import KERNELS, _frequencies, _product


def postures(count, p=3, seed=0, wide=1.0):
    return np.random.default_rng(seed).uniform(-wide, wide, (count, p))


def reach(q):
    """A planar arm of two links on a turning base."""
    far = 0.3 * np.cos(q[:, 1]) + 0.2 * np.cos(q[:, 1] + q[:, 2])
    up = 0.3 * np.sin(q[:, 1]) + 0.2 * np.sin(q[:, 1] + q[:, 2])
    return np.stack([far * np.cos(q[:, 0]), far * np.sin(q[:, 0]), up], 1)


@pytest.mark.parametrize("kernel", KERNELS)
def test_the_jacobian_is_the_derivative_of_the_image(kernel):
    q = postures(40)
    learned = KernelRidge(kernel, 1.3, 1e-3).fit(scattered(q, reach(q)))
    at = torch.from_numpy(postures(5, seed=1))
    slope = torch.func.vmap(torch.func.jacrev(lambda x: learned._image(x[None])[0]))(at)
    torch.testing.assert_close(learned.jacobian(at), slope, rtol=1e-10, atol=1e-12)
    [drawn] = learned.draws(1)
    slope = torch.func.vmap(torch.func.jacrev(lambda x: drawn._image(x[None])[0]))(at)
    torch.testing.assert_close(drawn.jacobian(at), slope, rtol=1e-10, atol=1e-12)


def test_products_of_sines_and_cosines_are_foretold_all_around_the_circle():
    q = postures(400, wide=np.pi)
    far = postures(50, seed=2, wide=2 * np.pi)
    learned = KernelRidge(width=1.5, penalty=1e-12).fit(scattered(q, reach(q)))
    np.testing.assert_allclose(learned.hand_image(far).numpy(), reach(far), atol=1e-6)


@pytest.mark.parametrize("kernel", KERNELS)
def test_it_interpolates_where_it_is_told_to(kernel):
    q = postures(80)
    learned = KernelRidge(kernel, 1.2, 1e-11).fit(scattered(q, reach(q)))
    np.testing.assert_allclose(learned.hand_image(q).numpy(), reach(q), atol=1e-5)


def test_a_full_turn_changes_nothing_but_to_the_gaussian_kernel():
    q = postures(40)
    at, turned = torch.from_numpy(q[:4]), torch.from_numpy(q[:4] + 2 * np.pi * np.array([1, -1, 0]))
    for kernel, same in (("trigonometric", True), ("periodic", True), ("gaussian", False)):
        learned = KernelRidge(kernel, 1.3, 1e-6).fit(scattered(q, reach(q)))
        assert torch.allclose(learned.hand_image(at), learned.hand_image(turned), atol=1e-9) == same


@pytest.mark.parametrize("kernel", KERNELS)
def test_random_waves_have_the_kernel_as_their_mean(kernel):
    rng = np.random.default_rng(0)
    frequencies = _frequencies(kernel, 1.2, (3, 400_000), rng)
    d = postures(6, seed=3)
    told = _product(kernel, 1.2, torch.from_numpy(d), torch.zeros(1, 3, dtype=torch.float64))[:, 0].numpy()
    np.testing.assert_allclose(np.cos(d @ frequencies).mean(1), told, atol=5e-3)


def test_what_is_not_given_is_chosen_on_what_is_held_out():
    rng = np.random.default_rng(1)
    q, far = postures(150), postures(200, seed=5)
    exp = scattered(q, reach(q) + 2e-3 * rng.standard_normal((150, 3)))

    def error(spec):
        return float((spec.fit(exp).hand_image(far) - torch.from_numpy(reach(far))).norm())

    best = error(KernelRidge("periodic"))
    assert best < 0.5 * error(KernelRidge("periodic", 0.15, 1e-3))
    assert best < 0.5 * error(KernelRidge("periodic", 1.5, 1.0))
    assert KernelRidge("periodic", width=1.1).fit(exp).width == 1.1


def test_the_noise_is_told():
    rng = np.random.default_rng(2)
    q = postures(300)
    learned = KernelRidge().fit(scattered(q, reach(q) + 3e-3 * rng.standard_normal((300, 3))))
    np.testing.assert_allclose(learned.noise.numpy(), 3e-3, rtol=0.25)


@pytest.mark.parametrize(
    "wrong", [{"kernel": "square"}, {"width": 0.5}, {"penalty": 0.0}, {"folds": 1}, {"most": 1}, {"width": "wide"}]
)
@pytest.mark.usefixtures("unchecked")
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(InvalidConfig, match=next(iter(wrong))):
        KernelRidge(**wrong)
