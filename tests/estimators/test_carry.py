"""What learners say where the data cannot carry them, and that they are silent where they can."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from experiences import scattered, taught

import bodyimage_kin as bk
from bodyimage_kin import estimators
from bodyimage_kin.errors import DataWarning

RNG = np.random.default_rng(0)
LEARNERS = [
    estimators.LeastSquares(),
    estimators.Ridge(1e-6),
    estimators.PaperMLP(steps=2),
    estimators.PostureMLP(hidden=(3,), steps=2),
    estimators.JacobianNetwork(hidden=(3,), steps=2),
    estimators.ForwardNetwork(hidden=(3,), steps=2),
    estimators.NearestNeighbours(),
    estimators.LocallyWeighted(0.5),
    estimators.TrigRidge(1, penalty=1e-6),
    estimators.Polynomial(1, penalty=1e-6),
    estimators.RationalTrig(1, penalty=1e-3),
    estimators.RationalPolynomial(1, penalty=1e-3),
    estimators.GaussianProcess(degree=1, most=20),
    estimators.Broyden(),
    estimators.RecursiveLeastSquares(),
    estimators.Kalman(),
]


def moved(spread, count=80):
    """A stream whose joints move by so much a step; the first two make the image."""
    dq = RNG.standard_normal((count, len(spread))) * spread
    exp = taught(dq, dq[:, :2])
    return exp.assign_coords(joint=["shoulder", "elbow", "wrist"][: len(spread)])


def told(spec, exp):
    """Every DataWarning of a fit."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        spec.fit(exp)
    assert all(issubclass(one.category, DataWarning) for one in caught)
    return caught


@pytest.mark.parametrize("spec", LEARNERS, ids=lambda spec: type(spec).__name__)
def test_a_joint_that_never_moves_is_named_in_one_line(spec):
    (one,) = told(spec, moved([0.1, 0.1, 0.0]))
    said = str(one.message)
    assert said.startswith(f"{type(spec).__name__}: wrist never moves")
    assert "\n" not in said
    # Of a line that asked for it, not of the library's own.
    assert not Path(one.filename).is_relative_to(Path(bk.__file__).parent)


@pytest.mark.parametrize("spec", LEARNERS, ids=lambda spec: type(spec).__name__)
def test_a_direction_that_hardly_moves_is_named_with_its_condition_number(spec):
    exp = moved([0.1, 0.1, 0.1])
    # Shoulder and wrist turn together, but for a hundred-thousandth.
    q = exp.q.values.copy()
    q[..., 2] = q[..., 0] + 1e-5 * q[..., 2]
    (one,) = told(spec, exp.assign(q=exp.q.copy(data=q)))
    said = str(one.message)
    assert "hardly move along" in said
    assert "shoulder" in said
    assert "wrist" in said
    assert "elbow" not in said
    assert "condition number" in said


@pytest.mark.parametrize("spec", LEARNERS, ids=lambda spec: type(spec).__name__)
def test_data_that_carry_are_learned_from_in_silence(spec, circle):
    assert not told(spec, moved([0.1, 0.1, 0.01]))
    assert not told(spec, bk.experience(circle))


def test_fewer_numbers_than_are_learned():
    dq = RNG.standard_normal((3, 5))
    exp = taught(dq, dq[:, :2])
    (one,) = told(estimators.LeastSquares(), exp)
    assert str(one.message) == "LeastSquares: 6 numbers seen cannot tell the 10 to be learned; record more"
    few = moved([0.1, 0.1, 0.1], count=20)
    assert [str(one.message) for one in told(estimators.PaperMLP(steps=2), few)] == [
        "PaperMLP: 40 numbers seen cannot tell the 62 to be learned; record more"
    ]
    assert not told(estimators.PaperMLP(hidden=4, steps=2), few)
    assert not told(estimators.Ridge(1e-6), exp)


def test_scattered_postures_and_wrapped_estimators_say_it_too():
    q = RNG.standard_normal((40, 3)) * [1.0, 1.0, 0.0]
    exp = scattered(q, q[:, :2]).assign_coords(joint=["shoulder", "elbow", "wrist"])
    for spec in (estimators.LeastSquares(), estimators.Conformal(estimators.LeastSquares(), level=0.5)):
        (one,) = told(spec, exp)
        assert str(one.message).startswith("LeastSquares: wrist never moves")


def test_whoever_looks_on_is_not_warned():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimators.pairs(moved([0.1, 0.1, 0.0]))
