"""Laws that hold for every family of estimators, old or new: add a spec to the list."""

import dataclasses

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import estimators
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidRecording

SPECS = {
    "Ridge": estimators.Ridge(),
    "PostureMLP": estimators.PostureMLP(hidden=(8,), steps=20),
    "JacobianNetwork": estimators.JacobianNetwork(hidden=(8, 7), steps=20),
    "ForwardNetwork": estimators.ForwardNetwork(hidden=(8,), steps=20),
    "NearestNeighbours": estimators.NearestNeighbours(),
    "LocallyWeighted": estimators.LocallyWeighted(),
    "TrigRidge": estimators.TrigRidge(),
    "Polynomial": estimators.Polynomial(),
    "KernelRidge": estimators.KernelRidge(most=60),
    "RationalTrig": estimators.RationalTrig(degree=2),
    "RationalPolynomial": estimators.RationalPolynomial(),
    "GaussianProcess": estimators.GaussianProcess(degree=2, most=60),
    "GaussianProcess-radial": estimators.GaussianProcess("radial", most=60),
    "Broyden": estimators.Broyden(),
    "RecursiveLeastSquares": estimators.RecursiveLeastSquares(),
    "Kalman": estimators.Kalman(),
    "Ensemble": estimators.Ensemble(estimators.ForwardNetwork(hidden=(4,), steps=5), members=2),
    "Conformal": estimators.Conformal(estimators.Ridge(), level=0.8),
    "Conformal-network": estimators.Conformal(estimators.ForwardNetwork(hidden=(4,), steps=5), level=0.8),
}


@pytest.fixture(scope="module", params=[*SPECS, "SelfCalibration"])
def name(request):
    return request.param


@pytest.fixture(scope="module")
def spec(name, body):
    return estimators.SelfCalibration(body, starts=1, steps=5) if name == "SelfCalibration" else SPECS[name]


@pytest.fixture(scope="module")
def exp(circle):
    return bk.experience(circle)


@pytest.fixture(scope="module")
def learned(spec, exp):
    return spec.fit(exp, seed=3)


@pytest.fixture(scope="module")
def q(body):
    generator = torch.Generator().manual_seed(0)
    return body.felt_home + 0.2 * torch.randn(4, 3, body.p, generator=generator, dtype=torch.float64)


def test_every_estimator_is_tested_here():
    tested = {name.partition("-")[0] for name in SPECS} | {"SelfCalibration"}
    assert (
        set(estimators.names()) - {"LeastSquares", "PaperMLP", "Analytic", "Given", "Saved", "Nominal", "Misinformed"}
        == tested
    )


def test_the_jacobian_is_the_derivative_of_the_displacement_at_rest(learned, q):
    step, flat = 1e-6, q.reshape(-1, learned.p)
    for joint in range(learned.p):
        dq = torch.zeros_like(flat)
        dq[:, joint] = step
        slope = (learned.displacement(flat, dq) - learned.displacement(flat, -dq)) / (2 * step)
        torch.testing.assert_close(learned.jacobian(flat)[..., joint], slope, rtol=1e-6, atol=1e-8)


def test_displacements_are_linear_where_they_say_so(name, learned, q):
    if name == "PostureMLP":
        pytest.skip("not linear in dq")
    dq = 0.3 * torch.flip(q, (-1,))
    torch.testing.assert_close(learned.displacement(q, dq), (learned.jacobian(q) @ dq[..., None])[..., 0])


def test_images_have_the_jacobian_as_derivative(learned, q):
    if not hasattr(learned, "hand_image"):
        pytest.skip("no image")
    flat = q.reshape(-1, learned.p)
    slope = torch.func.vmap(torch.func.jacrev(learned.hand_image))(flat)
    torch.testing.assert_close(learned.jacobian(flat), slope, rtol=1e-8, atol=1e-12)
    assert learned.hand_image(q).shape == (4, 3, 2)


def test_a_batch_is_its_postures_one_by_one(learned, q):
    whole = learned.jacobian(q)
    assert whole.shape == (4, 3, 2, 5)
    torch.testing.assert_close(learned.jacobian(q[2, 1]), whole[2, 1], rtol=1e-9, atol=1e-12)
    assert learned.jacobian(q[:0]).shape == (0, 3, 2, 5)
    assert learned.displacement(q[:0], q[:0]).shape == (0, 3, 2)


def test_dtype_out_is_dtype_in(learned, q):
    single = learned.jacobian(q.float())
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), learned.jacobian(q.float().double()), rtol=2e-2, atol=2e-3)
    assert learned.displacement(q.float(), q.float()).dtype == torch.float32
    with pytest.raises(InvalidPosture):
        learned.jacobian(q[..., :-1])


def test_same_seed_same_bits(spec, learned, exp, q):
    again = spec.fit(exp, seed=3)
    assert torch.equal(again.jacobian(q), learned.jacobian(q))


def test_learning_leaves_the_experience_as_it_was(spec, circle):
    exp = bk.experience(circle).copy(deep=True)
    spec.fit(exp, seed=1)
    assert exp.identical(bk.experience(circle))


def test_files_give_back_the_same_bits(learned, tmp_path, q):
    learned.save(tmp_path / "learned")
    again = bk.load_learned(tmp_path / "learned")
    assert type(again) is type(learned)
    assert torch.equal(again.jacobian(q), learned.jacobian(q))
    assert torch.equal(again.displacement(q, 0.1 * q), learned.displacement(q, 0.1 * q))


def test_nothing_to_learn_from_is_said(spec, exp, touch):
    with pytest.raises(InvalidRecording, match="seen"):
        spec.fit(bk.experience(touch))
    with pytest.raises(InvalidRecording, match="no joint moves"):
        spec.fit(exp.assign(q=exp.q.copy(data=np.ones(exp.q.shape))))


def test_several_at_once_are_each_alone(spec, exp, learned, body, q):
    shorter = exp.isel(time=slice(0, 90))
    many = spec.fit_many([shorter, exp, exp], [5, 3, 4])
    torch.testing.assert_close(many[1].jacobian(q), learned.jacobian(q), rtol=1e-6, atol=1e-9)
    torch.testing.assert_close(many[0].jacobian(q), spec.fit(shorter, 5).jacobian(q), rtol=1e-6, atol=1e-9)
    with pytest.raises(InvalidConfig, match="one seed each"):
        spec.fit_many([exp], [1, 2])


def test_specs_are_frozen_and_their_settings_checked(spec):
    field = dataclasses.fields(spec)[0].name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(spec, field, 1)
    for field in dataclasses.fields(spec):
        value = getattr(spec, field.name)
        if isinstance(value, bool):
            continue  # what is no truth value is refused by the types of the tests already
        if isinstance(value, int | float):
            with pytest.raises(InvalidConfig, match=field.name):
                dataclasses.replace(spec, **{field.name: -1 if isinstance(value, int) else float("nan")})
        if isinstance(value, int):
            with pytest.raises(InvalidConfig, match=field.name):
                dataclasses.replace(spec, **{field.name: True})
