"""Laws of the networks that see the posture."""

import dataclasses

import numpy as np
import pytest
import torch
from experiences import taught

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import ForwardNetwork, JacobianNetwork, PostureMLP
from bodyimage_kin.estimators._hold_out import arcs, chosen
from bodyimage_kin.estimators._training import Training, evaluate, first_layers, slope, train
from bodyimage_kin.metrics import pooled_relative_error

SPECS = [PostureMLP(steps=400), JacobianNetwork(steps=400), ForwardNetwork(steps=1500, weight_decay=0.0)]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: type(spec).__name__)
def test_a_jacobian_that_changes_with_posture_is_learned(spec):
    q = np.cumsum(0.1 * np.random.default_rng(0).standard_normal((600, 2)), axis=0)
    q = np.sin(q)
    image = np.stack([np.sin(2.0 * q[:, 0]), q[:, 0] * q[:, 1]], 1)
    learned = spec.fit(taught(np.diff(q, axis=0), np.diff(image, axis=0)), seed=0)
    # taught() begins at zero.
    at = q - q[0]
    true = np.zeros((len(q), 2, 2))
    true[:, 0, 0], true[:, 1, 0], true[:, 1, 1] = 2.0 * np.cos(2.0 * q[:, 0]), q[:, 1], q[:, 0]
    constant = true.mean(0) + np.zeros_like(true)
    assert pooled_relative_error(true, learned.jacobian(at)) < 0.5 * pooled_relative_error(true, constant)


@pytest.mark.parametrize("hidden", [(3,), (4, 5), (4, 5, 3)])
def test_the_slope_written_out_is_that_of_the_network(hidden):
    layers = [layer[0] for layer in first_layers([3, *hidden, 2], [7])]
    x = torch.randn(4, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    automatic = torch.func.vmap(torch.func.jacrev(lambda one: evaluate(layers, one)))(x)
    torch.testing.assert_close(slope(layers, x), automatic)
    torch.testing.assert_close(slope(layers, x, first=1), automatic[..., 1:])


def test_networks_trained_together_do_not_touch_each_other():
    x = torch.randn(3, 50, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    settings = Training(hidden=(4,), steps=30)

    def learn(models):
        def error(layers):
            return ((evaluate(layers, x[models]) - torch.sin(x[models])) ** 2).sum(-1)

        return train(
            first_layers([2, 4, 2], [10 + model for model in models]),
            error,
            torch.zeros(50, dtype=torch.bool),
            settings,
        )

    for alone, together in zip(learn([1]), learn([0, 1, 2]), strict=True):
        torch.testing.assert_close(alone[0], together[1], rtol=1e-9, atol=1e-12)


def test_the_weights_kept_are_those_best_on_what_was_held_out():
    x = torch.linspace(-1, 1, 40, dtype=torch.float64)[None, :, None]
    y = x + 0.5 * torch.randn(1, 40, 1, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    held, seen = chosen(arcs(40, 10), 0.2), []

    def error(layers):
        squared = ((evaluate(layers, x) - y) ** 2).sum(-1)
        seen.append(float(squared[0, held].detach().mean()))
        return squared

    best = train(first_layers([1, 16, 1], [0]), error, held, Training(hidden=(16,), steps=200, learning_rate=0.1))
    assert float(((evaluate(best, x) - y) ** 2).sum(-1)[0, held].mean()) == min(seen[:201])
    assert min(seen) < seen[200]


def test_what_is_held_out_moves_no_weight():
    """Not even by its gradient: whatever the held-out targets are, training goes the same way."""
    x = torch.linspace(-1, 1, 40, dtype=torch.float64)[None, :, None]
    held = chosen(arcs(40, 10), 0.2)

    def way(target_there):
        y, passed = torch.where(held[None, :, None], target_there, torch.sin(3.0 * x)), []

        def error(layers):
            passed.append([layer.detach().clone() for layer in layers])
            return ((evaluate(layers, x) - y) ** 2).sum(-1)

        train(first_layers([1, 6, 1], [0]), error, held, Training(hidden=(6,), steps=20))
        return passed

    for one, other in zip(way(100.0), way(-7.0), strict=True):
        assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: type(spec).__name__)
def test_networks_hold_out_the_share_they_say(spec, share, circle, monkeypatch):
    given = []

    def spy(layers, error, held, settings):
        given.append((held, error(layers).shape[1]))
        return layers

    monkeypatch.setattr("bodyimage_kin.estimators.networks.train", spy)
    dataclasses.replace(spec, held_out=share).fit(bk.experience(circle))
    ((held, count),) = given
    assert len(held) == count
    assert torch.equal(held, chosen(arcs(count, 10), share))


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: type(spec).__name__)
def test_recordings_of_unlike_blocks_are_held_out_each_by_its_own(spec, circle):
    """Of one length, and so learned side by side; what one holds out the other may learn."""
    count = circle.sizes["time"]
    numbers = np.arange(count) * 10 // count
    exps = [
        bk.experience(circle.assign(block=(("trial", "time"), block[None])))
        for block in (numbers, np.roll(numbers, count // 20))
    ]
    spec = dataclasses.replace(spec, steps=5)
    for one, exp in zip(spec.fit_many(exps, [0, 0]), exps, strict=True):
        for layer, alone in zip(one.layers, spec.fit(exp, 0).layers, strict=True):
            torch.testing.assert_close(layer, alone, rtol=1e-9, atol=1e-12)


def test_other_seeds_are_other_networks(circle):
    exp = bk.experience(circle)
    spec = ForwardNetwork(hidden=(4,), steps=3)
    assert not torch.equal(spec.fit(exp, 0).layers[0], spec.fit(exp, 1).layers[0])


@pytest.mark.parametrize("hidden", [(), (0,), [3], 3, (True,), (2.0,)])
def test_layers_are_counted_in_whole_units(hidden):
    with pytest.raises((InvalidConfig, TypeError), match="hidden"):
        PostureMLP(hidden=hidden)
