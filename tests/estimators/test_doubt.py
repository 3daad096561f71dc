"""Laws of uncertainty: covariances, draws, and promises that are kept as often as they say."""

import math

import numpy as np
import pytest
import scipy.stats
import torch
from experiences import scattered, taught

import bodyimage_kin as bk
from bodyimage_kin import estimators
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidRecording
from bodyimage_kin.estimators import Conformal, Drawn, Uncertain
from bodyimage_kin.estimators._samples import pairs
from bodyimage_kin.estimators.ridge import ridge_posterior

RNG = np.random.default_rng(0)


def cloud(count=90, noise=2e-3, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.0, 1.0, (count, 2))
    image = 0.05 * np.stack([np.sin(q[:, 0]) + np.sin(q[:, 1]) / 2, np.cos(q[:, 1]) * np.sin(q[:, 0])], 1)
    depth = 1.0 + 0.2 * np.cos(q[:, :1])
    return scattered(q, image / depth + noise * rng.standard_normal(image.shape))


SPECS = {
    "Ridge": estimators.Ridge(),
    "TrigRidge": estimators.TrigRidge(penalty=1e-6),
    "Polynomial": estimators.Polynomial(penalty=1e-6),
    "KernelRidge": estimators.KernelRidge(width=1.5, penalty=1e-4),
    "KernelRidge-periodic": estimators.KernelRidge("periodic", 1.5, 1e-4),
    "KernelRidge-gaussian": estimators.KernelRidge("gaussian", 1.5, 1e-4),
    "RationalTrig": estimators.RationalTrig(penalty=1e-4),
    "RationalPolynomial": estimators.RationalPolynomial(penalty=1e-4),
    "GaussianProcess": estimators.GaussianProcess(),
    "GaussianProcess-radial": estimators.GaussianProcess("radial"),
    "Ensemble": estimators.Ensemble(estimators.ForwardNetwork(hidden=(6,), steps=60), members=4),
    "Conformal": Conformal(estimators.Ridge(), level=0.8),
    "Conformal-network": Conformal(estimators.ForwardNetwork(hidden=(6,), steps=60), level=0.8),
}
DRAWN = [name for name in SPECS if not name.startswith("Conformal")]
AT = torch.tensor([[0.0, 0.0], [0.5, -0.3], [-0.6, 0.4]], dtype=torch.float64)
STEP = torch.tensor([[0.1, -0.2], [0.05, 0.1], [0.0, 0.3]], dtype=torch.float64)


@pytest.fixture(scope="module", params=SPECS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def learned(name):
    return SPECS[name].fit(cloud(), seed=1)


def entries(jacobians):
    return torch.stack([one.jacobian(AT).flatten(1) for one in jacobians])


# Covariances ----------------------------------------------------------------------------------------------------------


def test_a_covariance_is_one_at_every_posture(learned):
    assert isinstance(learned, Uncertain)
    found = learned.covariance(AT)
    assert found.shape == (3, 4, 4)
    torch.testing.assert_close(found, found.transpose(1, 2))
    assert torch.linalg.eigvalsh(found).min() > -1e-12 * found.abs().max()
    assert (found.diagonal(dim1=1, dim2=2) > 0).all()
    torch.testing.assert_close(learned.covariance(AT[1]), found[1])
    assert learned.covariance(AT.reshape(3, 1, 2)).shape == (3, 1, 4, 4)
    assert learned.covariance(AT[:0]).shape == (0, 4, 4)
    assert learned.covariance(AT.float()).dtype == torch.float32
    with pytest.raises(InvalidPosture):
        learned.covariance(AT[:, :1])


def test_a_displacements_covariance_is_that_of_the_jacobian_along_the_step(name, learned):
    found = learned.displacement_covariance(AT, STEP)
    assert found.shape == (3, 2, 2)
    # Row by row: entry = axis * p + joint.
    along = torch.stack([torch.kron(torch.eye(2, dtype=torch.float64), step[None]) for step in STEP])
    expected = along @ learned.covariance(AT) @ along.transpose(1, 2)
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-20)
    assert learned.displacement_covariance(AT[0], STEP).shape == (3, 2, 2)


def test_parts_change_nothing(learned, monkeypatch):
    q = AT.repeat(5, 1)
    whole = learned.covariance(q)
    monkeypatch.setattr("bodyimage_kin.estimators._field._AT_ONCE", 1)
    torch.testing.assert_close(learned.covariance(q), whole)


def test_files_keep_the_doubt(learned, tmp_path):
    learned.save(tmp_path)
    again = bk.load_learned(tmp_path)
    # A product rounds as its matrices lie in memory.
    torch.testing.assert_close(again.covariance(AT), learned.covariance(AT), rtol=1e-10, atol=1e-18)
    if isinstance(learned, Drawn):
        for one, other in zip(again.draws(3, seed=4), learned.draws(3, seed=4), strict=True):
            torch.testing.assert_close(one.jacobian(AT), other.jacobian(AT), rtol=1e-10, atol=1e-13)


# Draws ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DRAWN, indirect=True)
def test_draws_have_the_mean_and_the_covariance_they_are_drawn_from(name, learned):
    drawn = entries(learned.draws(1500, seed=0))
    mean, covariance = learned.jacobian(AT).flatten(1), learned.covariance(AT)
    sd = covariance.diagonal(dim1=1, dim2=2).sqrt()
    assert ((drawn.mean(0) - mean) / sd).abs().max() < 0.15
    away = drawn - drawn.mean(0)
    seen = torch.einsum("dia,dib->iab", away, away) / (len(drawn) - 1)
    # Members of an ensemble are few; random waves spread to a few per cent.
    tolerance = {"Ensemble": 0.35, "GaussianProcess-radial": 0.2}.get(name, 0.15)
    assert ((seen - covariance) / (sd[:, :, None] * sd[:, None, :])).abs().max() < tolerance


@pytest.mark.parametrize("name", DRAWN, indirect=True)
def test_a_draw_is_one_function_wherever_it_is_asked(learned):
    assert isinstance(learned, Drawn)
    drawn = learned.draws(5, seed=2)
    assert len(drawn) == 5
    for one in drawn:
        assert isinstance(one, estimators.Learned)
        torch.testing.assert_close(one.jacobian(AT[1]), one.jacobian(AT)[1])
        near = one.jacobian(AT + 1e-6)
        assert (near - one.jacobian(AT)).abs().max() < 1e-4
    assert torch.equal(entries(drawn), entries(learned.draws(5, seed=2)))
    assert not torch.equal(entries(drawn), entries(learned.draws(5, seed=3)))


@pytest.mark.parametrize("name", DRAWN, indirect=True)
def test_a_drawn_image_has_the_drawn_jacobian(name, learned, tmp_path):
    (one,) = learned.draws(1, seed=5)
    if isinstance(one, estimators.LearnedImage):
        slope = torch.func.vmap(torch.func.jacrev(one.hand_image))(AT)
        torch.testing.assert_close(one.jacobian(AT), slope, rtol=1e-8, atol=1e-12)
    one.save(tmp_path)
    assert torch.equal(bk.load_learned(tmp_path).jacobian(AT), one.jacobian(AT))
    for n in (0, -1, True):
        with pytest.raises(InvalidConfig, match="n="):
            learned.draws(n)


# Ridge regression -----------------------------------------------------------------------------------------------------


def test_what_ridge_leaves_open_is_bayesian_linear_regression():
    X, W = torch.from_numpy(RNG.standard_normal((50, 3))), torch.from_numpy(RNG.standard_normal((3, 2)))
    Y = X @ W + 0.1 * torch.from_numpy(RNG.standard_normal((50, 2)))
    root, noise = ridge_posterior(X, Y, W, penalty=0.02)
    precision = X.T @ X + 50 * 0.02 * torch.eye(3, dtype=torch.float64)
    torch.testing.assert_close(root @ root.T, torch.linalg.inv(precision))
    spent = torch.trace(X @ torch.linalg.inv(precision) @ X.T)
    torch.testing.assert_close(noise, (((Y - X @ W) ** 2).sum(0) / (50 - spent)).sqrt())


@pytest.mark.parametrize("full", [0, 500])
def test_more_functions_than_samples_are_as_open_as_the_prior(full, monkeypatch):
    monkeypatch.setattr("bodyimage_kin.estimators.ridge._FULL", full)
    X = torch.from_numpy(RNG.standard_normal((4, 9)))
    root, _ = ridge_posterior(X, X[:, :1], torch.zeros(9, 1, dtype=torch.float64), penalty=0.25)
    precision = X.T @ X + 4 * 0.25 * torch.eye(9, dtype=torch.float64)
    torch.testing.assert_close(root @ root.T, torch.linalg.inv(precision), rtol=1e-8, atol=1e-10)


def test_doubt_of_a_constant_jacobian_is_least_squares_own():
    true, dq = RNG.standard_normal((2, 3)), RNG.standard_normal((400, 3)) * [1.0, 0.3, 0.1]
    matrices, covariances = [], []
    for seed in range(80):
        dr = dq @ true.T + [0.1, 0.5] * np.random.default_rng(seed).standard_normal((400, 2))
        learned = estimators.Ridge(0.0).fit(taught(dq, dr))
        matrices.append(learned.matrix.flatten().numpy())
        covariances.append(learned.covariance([0.0] * 3).numpy())
    spread, told = np.var(matrices, axis=0), np.mean(covariances, axis=0).diagonal()
    np.testing.assert_allclose(told, spread, rtol=0.5)
    # A joint that moves less is known less, an axis with more noise too.
    assert told[2] > 50 * told[0]
    assert told[3] > 15 * told[0]


@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # it is about a joint at rest
def test_what_never_moved_is_open_without_end():
    dq = RNG.standard_normal((60, 3)) * [1.0, 1.0, 0.0]
    learned = estimators.Ridge(0.0).fit(taught(dq, dq[:, :2] + 0.01 * RNG.standard_normal((60, 2))))
    variance = learned.covariance([0.0] * 3).diagonal()
    assert (variance[[2, 5]] > 1e20 * variance[[0, 4]]).all()


@pytest.mark.parametrize("name", ["TrigRidge", "Polynomial", "RationalTrig", "RationalPolynomial"])
def test_refitting_with_other_noise_varies_as_much_as_is_doubted(name):
    """Over experiences that differ by noise alone; the prior's share makes the doubt the larger of the two."""
    base = cloud(seed=0, noise=0.0)
    fits = []
    for seed in range(20):
        noisy = base.hand_image + 2e-3 * np.random.default_rng(seed).standard_normal(base.hand_image.shape)
        fits.append(SPECS[name].fit(base.assign(hand_image=noisy)))
    sd = torch.stack([one.covariance(AT).diagonal(dim1=1, dim2=2).sqrt() for one in fits]).mean(0)
    ratio = entries(fits).std(0) / sd
    assert ratio.max() < 1.4
    assert ratio.median() > 0.3


# Promises -------------------------------------------------------------------------------------------------------------


def inside(learned, exp, level):
    """Share of displacements within the region of a level."""
    import scipy.stats

    data = estimators.pairs(exp)
    away = data.dr - learned.displacement(data.q, data.dq)
    doubt = learned.displacement_covariance(data.q, data.dq)
    squared = (away * torch.linalg.solve(doubt, away[..., None])[..., 0]).sum(-1)
    return float((squared <= scipy.stats.chi2.ppf(level, away.shape[1])).double().mean())


@pytest.mark.parametrize("level", [0.5, 0.9])
@pytest.mark.parametrize(
    "spec",
    [
        estimators.LeastSquares(),
        estimators.ForwardNetwork(hidden=(6,), steps=20),
        estimators.Ridge(1e-3),
        estimators.Polynomial(penalty=1e-6),
    ],
    ids=lambda spec: type(spec).__name__,
)
def test_a_promise_is_kept_on_what_is_like_what_was_kept_back(spec, level):
    shares = []
    for seed in range(8):
        exp = cloud(160, seed=seed)
        exp = exp.assign(block=exp.block.copy(data=np.random.default_rng(seed).permutation(160)[None] % 20))
        learned = Conformal(spec, level).fit(exp, seed)
        # As many as were kept back: the steps between nearest postures are as long.
        shares.append(inside(learned, cloud(48, seed=100 + seed), level))
    assert level - 0.08 < np.mean(shares) < level + 0.08


def test_doubt_grows_with_what_is_promised():
    exp = cloud(160)
    half, most = (Conformal(estimators.LeastSquares(), level).fit(exp) for level in (0.5, 0.95))
    assert half.displacement_covariance(AT, STEP).diagonal(dim1=1, dim2=2).min() > 0
    assert most.factor / half.factor != 1.0
    assert (most.level, half.level) == (0.95, 0.5)


def test_what_was_kept_back_was_not_learned_from(monkeypatch):
    exp, given = cloud(100), []
    real = estimators.LeastSquares.fit
    monkeypatch.setattr(estimators.LeastSquares, "fit", lambda self, exp, seed=0: given.append(exp) or real(self, exp))
    learned = Conformal(estimators.LeastSquares(), 0.7).fit(exp)
    hidden = np.isnan(given[0].hand_image.values).any(-1)[0]
    blocks = exp.block.values[0]
    assert 0 < hidden.sum() < 60
    assert not set(blocks[hidden]) & set(blocks[~hidden])
    # Poison in what is kept back moves the doubt, and nothing that is learned.
    poisoned = exp.hand_image.copy(deep=True)
    poisoned.values[0, hidden] += 10.0 * RNG.standard_normal((hidden.sum(), 2))
    again = Conformal(estimators.LeastSquares(), 0.7).fit(exp.assign(hand_image=poisoned))
    assert torch.equal(again.learned.matrix, learned.learned.matrix)
    assert again.factor > 100 * learned.factor


def test_it_is_what_it_is_around(circle):
    exp = bk.experience(circle)
    learned = Conformal(estimators.Ridge(1e-6), level=0.8).fit(exp)
    assert torch.equal(learned.jacobian(exp.q.values[0]), learned.learned.jacobian(exp.q.values[0]))
    own = learned.learned.covariance(exp.q.values[0, 0])
    torch.testing.assert_close(learned.covariance(exp.q.values[0, 0]), learned.factor * own)


def test_too_little_is_said(circle):
    exp = bk.experience(circle)
    with pytest.raises(InvalidRecording, match=r"cannot tell a level of 0\.999"):
        Conformal(estimators.LeastSquares(), level=0.999).fit(exp)
    with pytest.raises(InvalidRecording, match="a single block"):
        Conformal(estimators.LeastSquares()).fit(
            scattered(*[RNG.standard_normal((30, 2))] * 2, block=np.zeros(30, int))
        )
    for settings in ({"level": 1.0}, {"level": 0.0}, {"share": 0.0}, {"share": 0.9}):
        with pytest.raises(InvalidConfig, match=next(iter(settings))):
            Conformal(estimators.LeastSquares(), **settings)


@pytest.mark.parametrize("level", [0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95])
def test_the_doubt_holds_one_more_of_what_was_kept_back_than_its_share(level):
    """The rank of split conformal prediction, ``ceil((n + 1) level)``: with one less the promise is not kept."""
    exp = cloud()
    spec = Conformal(estimators.LeastSquares(), level)
    learned = spec.fit(exp)
    judged = pairs(spec._split(exp)[1])
    away = judged.dr - learned.displacement(judged.q, judged.dq)
    doubt = learned.displacement_covariance(judged.q, judged.dq)
    squared = (away * torch.linalg.solve(doubt, away[..., None])[..., 0]).sum(-1)
    # Of as much as lies on the border itself, rounding says nothing.
    held = int((squared <= scipy.stats.chi2.ppf(level, 2) * (1.0 + 1e-4)).sum())
    assert held == math.ceil((len(judged.dq) + 1) * level)
