"""Laws of Jacobians that were trained elsewhere."""

import numpy as np
import planar_arm
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidPosture
from bodyimage_kin.estimators import Given, Learned, LearnedImage, LeastSquares, Saved
from bodyimage_kin.study import specs

Q = torch.from_numpy(np.random.default_rng(0).uniform(0.2, 1.0, (6, 3)))
DQ = 0.1 * torch.flip(Q, (0,))


def jacobian(q):
    """Of tensors, without a gradient; found by workers under its name."""
    return planar_arm.jacobian(np.asarray(q)).copy()


def image(q):
    angles = q.cumsum(-1)
    links = torch.from_numpy(planar_arm.LINKS)
    return torch.stack([torch.cos(angles) @ links, torch.sin(angles) @ links], -1)


def moved(q, dq):
    return image(q + dq) - image(q)


TRUE = torch.from_numpy(planar_arm.jacobian(Q.numpy()).copy())


@pytest.mark.parametrize(
    "given",
    [
        Given(3, 2, jacobian=jacobian),
        Given(3, 2, jacobian=lambda q: torch.from_numpy(jacobian(q))),
        Given(3, 2, displacement=moved),
        Given(3, 2, displacement=lambda q, dq: moved(q, dq).detach().numpy()),
        Given(3, 2, jacobian=jacobian, displacement=moved),
        Given(3, 2, hand_image=image),
        Given(3, 2, hand_image=planar_arm.image, arrays=True),
        Given(3, 2, jacobian=planar_arm.jacobian, arrays=True, batched=False),
        Given(3, 2, jacobian=jacobian, batched=False),
        Given(3, 2, hand_image=image, batched=False),
        Given(3, 2, displacement=moved, batched=False),
    ],
    # Named by number: a function's own name has its address in it, which differs from worker to worker.
    ids=range(11),
)
def test_whatever_is_given_the_jacobian_is_right(given):
    learned = given.learned
    assert isinstance(learned, Learned)
    assert (learned.p, learned.m) == (3, 2)
    torch.testing.assert_close(learned.jacobian(Q), TRUE, rtol=1e-7, atol=1e-9)
    torch.testing.assert_close(learned.jacobian(Q[0]), TRUE[0], rtol=1e-7, atol=1e-9)
    assert learned.jacobian(Q.reshape(2, 3, 3)).shape == (2, 3, 2, 3)
    assert learned.jacobian(Q[:0]).shape == (0, 2, 3)
    assert learned.jacobian(Q.float()).dtype == torch.float32
    wanted = moved(Q, DQ) if given.displacement is not None else (TRUE @ DQ[..., None])[..., 0]
    torch.testing.assert_close(learned.displacement(Q, DQ), wanted, rtol=1e-7, atol=1e-9)
    with pytest.raises(InvalidPosture):
        learned.jacobian(Q[:, :2])


def test_a_torch_module_is_asked_in_its_own_dtype():
    torch.manual_seed(0)
    module = torch.nn.Sequential(torch.nn.Linear(3, 5), torch.nn.Tanh(), torch.nn.Linear(5, 2))
    learned = Given(3, 2, hand_image=module, unit="px").learned
    assert learned.unit == "px"
    assert isinstance(learned, LearnedImage)
    assert learned.hand_image(Q).dtype == learned.jacobian(Q).dtype == torch.float64
    torch.testing.assert_close(learned.hand_image(Q), module(Q.float()).double())
    slope = torch.func.vmap(torch.func.jacrev(module))(Q.float()).double()
    torch.testing.assert_close(learned.jacobian(Q), slope, rtol=1e-4, atol=1e-6)
    assert not learned.jacobian(Q).requires_grad


def test_derivatives_go_on_where_they_are_wanted():
    q = Q.clone().requires_grad_()
    Given(3, 2, hand_image=image).learned.jacobian(q).sum().backward()
    again = Q.clone().requires_grad_()
    torch.func.vmap(torch.func.jacrev(image))(again).sum().backward()
    torch.testing.assert_close(q.grad, again.grad)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "give jacobian="),
        ({"jacobian": 3}, "jacobian"),
        ({"jacobian": jacobian, "p": 0}, "p=0"),
        ({"jacobian": jacobian, "m": 2.0}, r"\bm\b"),
        ({"jacobian": jacobian, "hand_image": image}, "no other function beside it"),
        ({"jacobian": jacobian, "batched": 1}, "batched"),
        ({"jacobian": jacobian, "arrays": 1}, "arrays"),
    ],
)
def test_settings_are_checked(settings, message):
    # Types are refused before, where they are checked at run time.
    with pytest.raises((InvalidConfig, TypeError), match=message):
        Given(**{"p": 3, "m": 2, **settings})


def test_wrong_answers_are_named():
    with pytest.raises(InvalidArray, match=r"value of jacobian has shape \(6, 2, 3\); it must be \(6, 3, 3\)"):
        Given(3, 3, jacobian=jacobian).learned.jacobian(Q)
    with pytest.raises(InvalidArray, match="the value of displacement"):
        Given(3, 2, displacement=lambda q, dq: None).learned.displacement(Q, DQ)
    with pytest.raises(InvalidConfig, match="no_such_module"):
        _ = Given(3, 2, jacobian="no_such_module:jacobian").learned
    with pytest.raises(InvalidConfig, match="is float, no function"):
        _ = Given(3, 2, jacobian="math:pi").learned


def test_it_is_a_row_of_a_study_under_its_place(circle, tmp_path):
    given = Given(3, 2, jacobian=planar_arm.jacobian, arrays=True)
    assert given.jacobian == "planar_arm:jacobian"
    table = specs.ESTIMATOR.table(given)
    assert table["Given"]["jacobian"] == "planar_arm:jacobian"
    again = specs.ESTIMATOR.build(table)
    torch.testing.assert_close(again.fit(bk.experience(circle), 5).jacobian(Q), TRUE)
    with pytest.raises(InvalidConfig, match="cannot be written"):
        specs.ESTIMATOR.table(Given(3, 2, jacobian=lambda q: q))


def test_what_was_saved_is_a_row_too(circle, tmp_path):
    exp = bk.experience(circle)
    LeastSquares(scale=0.5).fit(exp).save(tmp_path / "mine")
    row = specs.ESTIMATOR.build(specs.ESTIMATOR.table(Saved(tmp_path / "mine")))
    assert torch.equal(row.fit(exp.isel(time=slice(0, 30))).matrix, LeastSquares(scale=0.5).fit(exp).matrix)
    with pytest.raises(InvalidConfig, match="holds no learned Jacobian"):
        Saved("nowhere").fit(exp)
    with pytest.raises(InvalidConfig, match="folder"):
        Saved("")


def test_what_is_given_is_not_saved(tmp_path):
    with pytest.raises(InvalidConfig, match="GivenJacobian cannot be saved"):
        Given(3, 2, jacobian=jacobian).learned.save(tmp_path)
