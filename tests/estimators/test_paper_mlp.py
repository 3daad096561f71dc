"""Laws of the paper's network."""

import math

import numpy as np
import pytest
import torch
from experiences import taught

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import PaperMLP, pairs


@pytest.fixture(scope="module")
def exp(circle):
    return bk.experience(circle)


def scales(data):
    """Standard deviations, those of the whole population."""
    return data.dq.numpy().std(0), data.dr.numpy().std(0)


def scaled_weights(learned, data):
    """The weights as they were trained, on scaled inputs and outputs."""
    x, y = map(torch.from_numpy, scales(data))
    return learned.W1 * x, learned.b1, learned.W2 / y[:, None], learned.b2 / y


def test_steps_are_gradient_descent_on_the_stated_loss(exp):
    data = pairs(exp)
    x_scale, y_scale = map(torch.from_numpy, scales(data))
    x, y = data.dq / x_scale, data.dr / y_scale
    weights = [w.clone() for w in scaled_weights(PaperMLP(steps=0).fit(exp, seed=4), data)]
    for _ in range(5):
        for w in weights:
            w.requires_grad_()
        W1, b1, W2, b2 = weights
        f = torch.tanh(x @ W1.T + b1) @ W2.T + b2
        loss = 0.5 * ((f - y) ** 2).sum(1).mean()
        gradients = torch.autograd.grad(loss, weights)
        weights = [(w - 0.2 * g).detach() for w, g in zip(weights, gradients, strict=True)]
    learned = scaled_weights(PaperMLP(steps=5, learning_rate=0.2).fit(exp, seed=4), data)
    for actual, expected in zip(learned, weights, strict=True):
        torch.testing.assert_close(actual, expected, atol=1e-12, rtol=0)


@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # many units, for statistics
def test_first_weights_are_uniform_within_the_inverse_root_of_the_inputs(exp):
    data = pairs(exp)
    W1, b1, W2, b2 = scaled_weights(PaperMLP(hidden=400, steps=0).fit(exp, seed=0), data)
    for weights, inputs in ((W1, 5), (b1, 5), (W2, 400)):
        bound = 1 / math.sqrt(inputs)
        assert float(weights.abs().max()) <= bound * (1 + 1e-12)
        assert float(weights.abs().max()) > 0.97 * bound
        assert float(weights.std()) == pytest.approx(bound / math.sqrt(3), rel=0.1)
    assert (b2.abs() <= 1 / 20).all()


def test_seeds_draw_the_weights_and_nothing_else(exp):
    one, same, other = (PaperMLP(steps=10).fit(exp, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(one.W1, same.W1)
    assert not torch.equal(one.W1, other.W1)


def test_more_steps_fit_better_and_a_constant_jacobian_is_learned():
    rng = np.random.default_rng(0)
    true, dq = 0.01 * rng.normal(size=(2, 5)), 0.02 * rng.normal(size=(200, 5))
    exp = taught(dq, dq @ true.T)
    errors = []
    for steps in (0, 50, 2000):
        learned = PaperMLP(steps=steps).fit(exp)
        errors.append(float((learned.displacement(dq, dq) - torch.from_numpy(dq @ true.T)).norm()))
    assert errors[2] < 0.5 * errors[1] < 0.25 * errors[0]
    secant = learned.secant(torch.from_numpy(dq)).numpy()
    np.testing.assert_allclose(secant, true, atol=0.05 * np.abs(true).max())


def test_the_bias_is_what_it_predicts_at_rest(exp):
    learned = PaperMLP().fit(exp, seed=2)
    rest = torch.zeros(5, dtype=torch.float64)
    torch.testing.assert_close(learned.displacement(rest, rest), learned.bias)
    assert float(learned.bias.norm()) > 0


def test_the_secant_by_its_formula(exp):
    # E[(f - f(0)) dq'] E[dq dq']^-1, written out.
    learned, dq = PaperMLP(steps=20).fit(exp), pairs(exp).dq
    response = learned.displacement(dq, dq) - learned.bias
    torch.testing.assert_close(
        learned.secant(dq), (response.T @ dq) @ torch.linalg.inv(dq.T @ dq), atol=1e-9, rtol=1e-6
    )
    # Where the motion is small, all three Jacobians of f are one.
    torch.testing.assert_close(learned.secant(1e-7 * dq), learned.jacobian(dq[0]), atol=1e-7, rtol=1e-5)


def test_the_posture_is_no_input(exp):
    learned = PaperMLP(steps=5).fit(exp)
    dq = pairs(exp).dq[:3]
    assert torch.equal(learned.displacement(dq * 0.0, dq), learned.displacement(dq + 1.0, dq))
    assert torch.equal(learned.jacobian(dq)[0], learned.jacobian(dq)[1])


@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # it is about a joint at rest
def test_a_joint_that_never_moves_spoils_nothing():
    rng = np.random.default_rng(1)
    dq = rng.normal(size=(50, 3)) * [1.0, 0.0, 1.0]
    learned = PaperMLP().fit(taught(dq, dq[:, :2]))
    assert all(torch.isfinite(array).all() for array in learned.arrays().values())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"hidden": 0}, "hidden=0: give a whole number of at least 1"),
        ({"hidden": True}, "hidden=True"),
        ({"learning_rate": 0.0}, "learning_rate=0.0: give a number above 0"),
        ({"learning_rate": math.nan}, "learning_rate=nan"),
        ({"learning_rate": math.inf}, "learning_rate=inf"),
        ({"steps": -1}, "steps=-1: give a whole number of at least 0"),
    ],
)
def test_settings_out_of_range_are_named(settings, message):
    with pytest.raises(InvalidConfig, match=message):
        PaperMLP(**settings)


def test_networks_learn_side_by_side_what_each_learns_alone(exp):
    shorter = exp.isel(time=slice(0, 100))
    spec = PaperMLP(steps=30)
    together = spec.fit_many([exp, shorter, exp], [0, 1, 2])
    for learned, given, seed in zip(together, [exp, shorter, exp], [0, 1, 2], strict=True):
        alone = spec.fit(given, seed)
        for name, weights in alone.arrays().items():
            torch.testing.assert_close(learned.arrays()[name], weights, atol=1e-12, rtol=1e-12)


@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # few samples, worked through by hand
def test_online_updates_are_gradient_descent_after_each_sample(exp):
    few = exp.isel(time=slice(0, 12))
    data = pairs(few)
    x_scale, y_scale = map(torch.from_numpy, scales(data))
    weights = [w.clone() for w in scaled_weights(PaperMLP(steps=0).fit(few, seed=4), data)]
    for _ in range(3):
        for x, y in zip(data.dq / x_scale, data.dr / y_scale, strict=True):
            for w in weights:
                w.requires_grad_()
            W1, b1, W2, b2 = weights
            loss = 0.5 * ((W2 @ torch.tanh(W1 @ x + b1) + b2 - y) ** 2).sum()
            gradients = torch.autograd.grad(loss, weights)
            weights = [(w - 0.05 * g).detach() for w, g in zip(weights, gradients, strict=True)]
    spec = PaperMLP(steps=3, learning_rate=0.05, online=True)
    learned = scaled_weights(spec.fit(few, seed=4), data)
    for actual, expected in zip(learned, weights, strict=True):
        torch.testing.assert_close(actual, expected, atol=1e-12, rtol=0)
    assert torch.equal(spec.fit_many([few, few], [1, 4])[1].W1, spec.fit(few, seed=4).W1)
