"""Axes of unlike spread and unit, any number of them, and truths that nobody may see: laws of every estimator."""

import numpy as np
import planar_arm
import pytest
import torch
from experiences import taught

import bodyimage_kin as bk
from bodyimage_kin import estimators

SPECS = {
    "LeastSquares": estimators.LeastSquares(),
    "Ridge": estimators.Ridge(),
    "PaperMLP": estimators.PaperMLP(),
    "PaperMLP-online": estimators.PaperMLP(steps=20, online=True),
    "PostureMLP": estimators.PostureMLP(hidden=(8,), steps=300),
    "JacobianNetwork": estimators.JacobianNetwork(hidden=(8,), steps=300),
    "ForwardNetwork": estimators.ForwardNetwork(hidden=(8,), steps=300),
    "NearestNeighbours": estimators.NearestNeighbours(),
    "LocallyWeighted": estimators.LocallyWeighted(),
    "TrigRidge": estimators.TrigRidge(),
    "Polynomial": estimators.Polynomial(),
    "KernelRidge": estimators.KernelRidge(most=100),
    "RationalTrig": estimators.RationalTrig(),
    "RationalPolynomial": estimators.RationalPolynomial(),
    "GaussianProcess": estimators.GaussianProcess(most=150),
    "GaussianProcess-radial": estimators.GaussianProcess("radial", most=150),
    "Broyden": estimators.Broyden(),
    "RecursiveLeastSquares": estimators.RecursiveLeastSquares(),
    "Kalman": estimators.Kalman(),
    "Ensemble": estimators.Ensemble(estimators.JacobianNetwork(hidden=(8,), steps=300), members=2),
    "Conformal": estimators.Conformal(estimators.LeastSquares()),
}
LEARNED_ALREADY = {"Given", "Saved", "Nominal"}
BODIES = {"SelfCalibration", "Analytic"}
BY_ANOTHER = {"Misinformed"}
"""Their images are those of a camera: no axis has a unit of its own."""
ANGLES = {"TrigRidge", "RationalTrig", "GaussianProcess", "KernelRidge"}
"""They read joints as angles: ten times a joint is another chain. A tenth of one is nearly a straight line."""


def wander(count=300):
    q = np.cumsum(0.08 * np.random.default_rng(0).standard_normal((count, 3)), axis=0)
    return 0.6 * np.sin(q) + [0.3, 0.5, 0.4]


def seen(q, image):
    exp = taught(np.diff(q, axis=0), np.diff(image, axis=0), image.shape[1])
    return exp.assign(q=exp.q + q[0], hand_image=exp.hand_image + image[0])


def learned(spec, axes=1.0, joints=1.0):
    """The Jacobian along the motion, learned in other units and told in the old ones."""
    q = wander()
    J = spec.fit(seen(q * joints, planar_arm.image(q) * axes), seed=0).jacobian(q * joints).numpy()
    return J * joints / np.reshape(axes, (-1, 1))


def apart(one, other):
    """The largest relative difference of an axis."""
    return max(np.linalg.norm(one[:, axis] - other[:, axis]) / np.linalg.norm(other[:, axis]) for axis in range(2))


def test_every_estimator_is_asked():
    assert {name.partition("-")[0] for name in SPECS} | BODIES | LEARNED_ALREADY | BY_ANOTHER == set(estimators.names())


@pytest.mark.parametrize("name", SPECS)
def test_an_axis_in_another_unit_scales_its_row(name):
    spec, axes = SPECS[name], np.array([1000.0, 1.0])
    # Penalties and kernels are chosen by all axes together; the smallest penalties are at the edge of rounding.
    shared = {"Ridge": 0.03, "RationalTrig": 0.01, "RationalPolynomial": 0.03, "Polynomial": 1e-3}
    shared |= {"GaussianProcess": 1e-3, "GaussianProcess-radial": 1e-3}
    tolerance = shared.get(name, 1e-5)
    plain = learned(spec)
    assert apart(learned(spec, axes), plain) < tolerance
    assert apart(learned(spec, 1.0 / axes), plain) < tolerance


@pytest.mark.parametrize("name", SPECS)
def test_a_joint_in_another_unit_scales_its_column(name):
    spec = SPECS[name]
    plain = learned(spec)
    exact = {"LeastSquares", "PaperMLP", "PaperMLP-online", "RecursiveLeastSquares"}
    # The others measure distance or the size of a step over all joints: one that is ten times as wide counts more.
    tolerance = 1e-6 if name in exact else 0.3
    for joints in ([10.0, 1.0, 1.0], [1.0, 1.0, 10.0]) if name not in ANGLES else ():
        assert apart(learned(spec, joints=np.array(joints)), plain) < tolerance
    assert apart(learned(spec, joints=np.array([1.0, 1.0, 0.1])), plain) < tolerance
    if name not in ANGLES:
        both = learned(spec, np.array([1000.0, 1.0]), np.array([10.0, 1.0, 1.0]))
        assert apart(both, plain) < max(tolerance, 1e-5)


@pytest.mark.parametrize("m", [1, 3, 4])
@pytest.mark.parametrize("name", SPECS)
def test_an_image_has_any_number_of_axes(name, m):
    q = wander(150)
    x, y = planar_arm.image(q).T
    image = np.stack([x, y, x + y, x * y][:m], 1)
    found = SPECS[name].fit(seen(q, image), seed=0)
    assert (found.m, found.p) == (m, 3)
    at = torch.from_numpy(q[:7])
    assert found.jacobian(at).shape == (7, m, 3)
    assert found.displacement(at, at).shape == (7, m)
    if m == 3 and name not in ("Broyden", "Kalman"):
        J = found.jacobian(at)
        torch.testing.assert_close(J[:, 2], J[:, 0] + J[:, 1], atol=0.12, rtol=0)


@pytest.mark.parametrize("name", [*SPECS, *sorted(BODIES)])
def test_the_truth_beside_a_recording_is_never_learned_from(name, circle, body):
    quick = {"SelfCalibration": {"starts": 1, "steps": 5}, "Analytic": {}}
    spec = SPECS[name] if name in SPECS else getattr(estimators, name)(body, **quick[name])
    rng = np.random.default_rng(0)
    lying = circle.copy(deep=True)
    changed = [variable for variable in lying.data_vars if str(variable).startswith("true_")]
    assert len(changed) >= 4
    for variable in changed:
        values = lying[variable].values
        whole = values.dtype.kind == "i"
        lying[variable].values[:] = rng.integers(-1, 400, values.shape) if whole else rng.standard_normal(values.shape)
    few = {"time": slice(0, 60)}
    at = body.felt_home + 0.1 * torch.eye(5, dtype=torch.float64)
    honest, fooled = (spec.fit(bk.experience(one.isel(few)), 1).jacobian(at) for one in (circle, lying))
    # Handed over with the truth, they do not look either.
    careless = spec.fit(lying.isel(few), 1).jacobian(at)
    assert torch.equal(honest, fooled)
    assert torch.equal(honest, careless)
