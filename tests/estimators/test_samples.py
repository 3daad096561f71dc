"""Laws of what is taken from an experience: steps of a stream, edges of a scattered recording, and what is held out."""

import numpy as np
import pytest
import torch
import xarray as xr
from experiences import scattered, shuffled, taught
from hypothesis import given
from hypothesis import strategies as st

import bodyimage_kin as bk
from bodyimage_kin import estimators
from bodyimage_kin.errors import InvalidArray, InvalidRecording
from bodyimage_kin.estimators import edges, pairs
from bodyimage_kin.estimators._hold_out import arcs, choose, chosen, clusters, grouped, halves
from bodyimage_kin.estimators._samples import fold_of_each, samples


def cloud(count=60, p=3, seed=0):
    q = np.random.default_rng(seed).standard_normal((count, p)) * np.linspace(1.0, 0.1, p)
    return q, np.stack([np.sin(q).sum(1), q[:, 0] * q[:, 1]], 1)


# Dtypes ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.int32, np.uint8])
def test_numbers_of_any_kind_teach_as_float64(dtype):
    q = np.cumsum(np.random.default_rng(0).integers(0, 3, (30, 3)), axis=0).astype(dtype)
    image = (2 * q[:, :2]).astype(dtype)
    exp = taught(np.diff(q.astype(float), axis=0), np.diff(image.astype(float), axis=0))
    given_ = exp.assign(q=exp.q.copy(data=q[None]), hand_image=exp.hand_image.copy(data=image[None]))
    for data in (pairs(given_), samples(given_)):
        assert data.q.dtype == torch.float64
    torch.testing.assert_close(estimators.Ridge(1e-9).fit(given_).matrix, estimators.Ridge(1e-9).fit(exp).matrix)


@pytest.mark.parametrize("data", [np.full((1, 30, 2), True), np.full((1, 30, 2), "1"), np.full((1, 30, 2), 1j)])
def test_what_is_no_number_is_refused(data):
    exp = scattered(*cloud(30))
    with pytest.raises(InvalidRecording, match="'hand_image' holds"):
        pairs(exp.assign(hand_image=exp.hand_image.copy(data=data)))


# Edges ----------------------------------------------------------------------------------------------------------------


def test_each_is_joined_with_its_nearest_and_each_pair_is_there_once():
    q, _ = cloud(40)
    found = edges(q)
    joined = {frozenset(edge) for edge in found.tolist()}
    assert len(joined) == len(found)
    scaled = q / q.std(0)
    away = np.linalg.norm(scaled[:, None] - scaled[None], axis=-1)
    wanted = {frozenset((i, j)) for i in range(40) for j in np.argsort(away[i])[1:5].tolist()}
    assert joined == wanted


@given(st.integers(2, 12), st.integers(1, 4), st.integers(0, 10))
def test_edges_join_distinct_postures_whatever_repeats(count, p, seed):
    q = np.random.default_rng(seed).integers(0, 3, (count, p)).astype(float)
    first, last = edges(q).T
    assert all((q[i] != q[j]).any() for i, j in zip(first, last, strict=True))
    # Of postures that are one, the first alone is joined.
    for i in {*first.tolist(), *last.tolist()}:
        assert not (q[:i] == q[i]).all(1).any()
    distinct = len(np.unique(q, axis=0))
    assert len(first) >= (distinct if distinct > 2 else distinct - 1) - (distinct > 2)
    assert len(first) <= 4 * distinct


def test_displacements_point_every_way():
    """Oriented by a rule of the rows, a network of dq would never see half of the displacements."""
    exp = scattered(*cloud(200))
    dq = pairs(exp).dq
    assert ((dq > 0).double().mean(0) > 0.3).all()
    assert ((dq > 0).double().mean(0) < 0.7).all()
    assert (dq.mean(0).abs() < 0.25 * dq.std(0)).all()


def test_an_edge_is_taken_half_way():
    q, _ = cloud(40)
    data = pairs(scattered(q, q[:, :2] ** 2))
    # The slope of a parabola at the middle of a chord is the chord's.
    torch.testing.assert_close(data.dr, 2.0 * data.q[:, :2] * data.dq[:, :2])


def test_repeats_of_a_posture_are_dropped():
    q, image = cloud(30)
    again = np.concatenate([q, q[:10] + 0.5e-3]), np.concatenate([image, image[:10] + 1.0])
    alone = pairs(scattered(q, image)).dq
    stated = pairs(scattered(*again, encoder_noise=1e-3))
    assert stated.dq.abs().max(1).values.min() > 2e-3
    assert len(stated.dq) == len(alone)
    assert pairs(scattered(*again)).dq.abs().max(1).values.min() < 1e-3
    number = np.concatenate([np.arange(10), np.full(20, -1), np.arange(10)])
    exp = scattered(*again)
    counted = pairs(exp.assign(repeat=(("trial", "time"), number[None])))
    assert len(counted.dq) == len(alone)
    assert counted.dq.abs().max(1).values.min() > 1e-3


def test_unseen_rows_are_left_out():
    q, image = cloud(30)
    image[3], q[5, 1] = np.nan, np.nan
    kept = np.isfinite(q).all(1) & np.isfinite(image).all(1)
    whole, some = pairs(scattered(q, image)), pairs(scattered(q[kept], image[kept], block=(np.arange(30) // 6)[kept]))
    assert torch.equal(whole.dq, some.dq)


def test_postures_that_are_all_one_teach_nothing():
    with pytest.raises(InvalidRecording, match="no joint moves"):
        pairs(scattered(np.ones((9, 3)), np.arange(18.0).reshape(9, 2)))


@pytest.mark.parametrize(("q", "settings"), [([1.0], {}), (np.zeros((3, 0)), {}), ("q", {})])
def test_what_is_no_posture_has_no_edges(q, settings):
    with pytest.raises(InvalidArray):
        edges(q, **settings)


# What a recording must be ---------------------------------------------------------------------------------------------


def test_an_observed_point_that_moves_in_the_hand_is_refused():
    exp = scattered(*cloud(30))
    offset = np.zeros((1, 30, 3))
    dims = ("trial", "time", "space")
    one = pairs(exp)
    assert torch.equal(pairs(exp.assign(hand_offset=(dims, offset + 0.01))).dq, one.dq)
    offset[0, 7] = 0.02
    with pytest.raises(InvalidRecording, match="hand_offset varies"):
        pairs(exp.assign(hand_offset=(dims, offset)))
    # Where nothing is seen there, it does not matter.
    image = exp.hand_image.copy(deep=True)
    image.values[0, 7] = np.nan
    pairs(exp.assign(hand_offset=(dims, offset), hand_image=image))


def test_an_unknown_order_is_refused():
    exp = scattered(*cloud(30)).assign_attrs(order="random")
    with pytest.raises(InvalidRecording, match="one of 'stream', 'scattered'"):
        pairs(exp)


def test_blocks_are_counted():
    exp = scattered(*cloud(30))
    with pytest.raises(InvalidRecording, match="'block' holds numbers that are not whole"):
        pairs(exp.assign(block=exp.block * 1.5))


@pytest.mark.parametrize("spec", [estimators.Broyden(), estimators.Kalman(), estimators.RecursiveLeastSquares()])
def test_who_learns_along_a_stream_refuses_what_has_none(spec):
    with pytest.raises(InvalidRecording, match=f"{type(spec).__name__} learns step by step along a stream.*Ridge"):
        spec.fit(scattered(*cloud(30)))


def test_the_papers_network_online_refuses_too():
    exp = scattered(*cloud(30))
    estimators.PaperMLP(steps=2).fit(exp)
    for fit in (lambda spec: spec.fit(exp), lambda spec: spec.fit_many([exp], [0])):
        with pytest.raises(InvalidRecording, match="online=False"):
            fit(estimators.PaperMLP(steps=2, online=True))


# Order changes nothing ------------------------------------------------------------------------------------------------

EVERY = {
    "LeastSquares": estimators.LeastSquares(),
    "Ridge": estimators.Ridge(),
    "PaperMLP": estimators.PaperMLP(steps=20),
    "PostureMLP": estimators.PostureMLP(hidden=(6,), steps=20),
    "JacobianNetwork": estimators.JacobianNetwork(hidden=(6,), steps=20),
    "ForwardNetwork": estimators.ForwardNetwork(hidden=(6,), steps=20),
    "NearestNeighbours": estimators.NearestNeighbours(),
    "LocallyWeighted": estimators.LocallyWeighted(),
    "TrigRidge": estimators.TrigRidge(degree=2),
    "Polynomial": estimators.Polynomial(degree=2),
    "KernelRidge": estimators.KernelRidge(),
    "RationalTrig": estimators.RationalTrig(degree=2),
    "RationalPolynomial": estimators.RationalPolynomial(),
    "GaussianProcess": estimators.GaussianProcess(degree=2, most=40),
    "GaussianProcess-radial": estimators.GaussianProcess("radial", most=40),
    "Ensemble": estimators.Ensemble(estimators.Ridge(), members=2, missing=0.3),
    "Conformal": estimators.Conformal(estimators.Ridge(), level=0.7),
}
STREAMS_ALONE = {"Broyden", "RecursiveLeastSquares", "Kalman"}
LEARNED_ALREADY = {"Given", "Saved", "Nominal"}
OF_A_BODY = {"SelfCalibration": {"starts": 1, "steps": 5}, "Analytic": {}}
BY_ANOTHER = {"Misinformed"}


@pytest.fixture(scope="module")
def poses(body):
    generator = torch.Generator().manual_seed(0)
    q = body.felt_home + 0.15 * torch.randn(120, body.p, generator=generator, dtype=torch.float64)
    q = q[body.hand_in_camera(q)[:, 2] > 0.03][:70]
    return scattered(q.numpy(), body.hand_image(q).numpy()).assign_coords(joint=list(body.joints))


def test_every_estimator_is_asked():
    asked = {name.partition("-")[0] for name in EVERY} | STREAMS_ALONE | set(OF_A_BODY) | LEARNED_ALREADY | BY_ANOTHER
    assert asked == set(estimators.names())


@pytest.mark.parametrize("blocks", [True, False])
@pytest.mark.parametrize("name", [*EVERY, *OF_A_BODY])
def test_shuffled_rows_teach_the_same(name, blocks, poses, body):
    spec = EVERY[name] if name in EVERY else getattr(estimators, name)(body, **OF_A_BODY[name])
    exp = poses if blocks else poses.drop_vars("block")
    at = body.felt_home + 0.05 * torch.eye(5, dtype=torch.float64)
    learned = spec.fit(exp, seed=2).jacobian(at)
    for seed in range(2):
        again = spec.fit(shuffled(exp, seed), seed=2).jacobian(at)
        torch.testing.assert_close(again, learned, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "spec",
    [
        estimators.NearestNeighbours(),
        estimators.LocallyWeighted(),
        estimators.JacobianNetwork(hidden=(8,), steps=300),
    ],
)
def test_edges_teach_what_successive_rows_cannot(spec, poses, body):
    at = torch.from_numpy(poses.q.values[0])
    true = body.hand_image_jacobian(at)
    near, in_turn = (
        bk.metrics.pooled_relative_error(true, spec.fit(exp).jacobian(at))
        for exp in (poses, poses.assign_attrs(order="stream"))
    )
    assert near < 0.8 * in_turn


# What is held out -----------------------------------------------------------------------------------------------------


def test_arcs_are_contiguous_and_even():
    fold = arcs(23, 5)
    assert (fold.diff() >= 0).all()
    assert sorted(fold.unique().tolist()) == [0, 1, 2, 3, 4]
    assert set(fold.bincount().tolist()) <= {4, 5}
    assert arcs(3, 5).tolist() == [0, 1, 2]


def test_blocks_stay_together():
    block = torch.tensor([7, 7, 3, 3, 3, 9, 12, 12])
    fold = grouped(block, 10)
    assert fold.tolist() == [1, 1, 0, 0, 0, 2, 3, 3]
    assert set(grouped(block, 2).tolist()) == {0, 1}
    # Neighbouring numbers stay together: blocks are numbered along the recording.
    assert grouped(torch.tensor([12, 0, 0, 5, 7, 9, 5, 12]), 2).tolist() == [1, 0, 0, 0, 0, 1, 0, 1]
    for one in block.unique():
        assert len(grouped(block, 2)[block == one].unique()) == 1


def test_clusters_are_even_and_apart():
    q, _ = cloud(101)
    fold = clusters(q, 5)
    assert set(np.bincount(fold)) <= {20, 21}
    within = np.mean([q[fold == one].var(0).sum() for one in range(5)])
    assert within < 0.6 * q.var(0).sum()


def test_what_is_chosen_was_best_on_what_it_did_not_learn_from():
    seen = []

    def errors(learn, predict):
        assert not (learn & predict).any()
        assert (learn | predict).all()
        seen.append(predict)
        return torch.tensor([torch.nan, 2.0, 1.0, 3.0])

    assert choose(errors, halves(arcs(10, 5))) == 2
    assert torch.stack(seen).sum(0).tolist() == [1] * 10


def test_held_out_are_whole_arcs():
    held = chosen(arcs(100, 10), 0.2)
    assert held.sum() == 20
    assert (held.long().diff() != 0).sum() <= 4
    assert not chosen(arcs(100, 10), 0.0).any()
    assert not chosen(arcs(5, 10), 0.2).any()


@pytest.mark.parametrize("with_blocks", [True, False])
def test_no_edge_joins_what_is_held_out_with_what_is_learned_from(with_blocks):
    exp = scattered(*cloud(80))
    exp = exp if with_blocks else exp.drop_vars("block")
    data, halves_seen = samples(exp), 0
    fold = data.fold(5)
    image = {tuple(one): int(f) for one, f in zip(data.q.tolist(), fold, strict=True)}

    def folds_of(some):
        ends = torch.cat([some.q - some.dq / 2, some.q + some.dq / 2])
        known = torch.tensor(list(image))
        return {int(fold[((known - end).abs().amax(1)).argmin()]) for end in ends}

    for learn, predict in pairs(exp).folds(5):
        assert len(folds_of(predict)) == 1
        assert not folds_of(predict) & folds_of(learn)
        halves_seen += 1
    assert halves_seen == 5


@pytest.mark.parametrize("order", ["stream", "scattered"])
def test_blocks_are_held_out_whole(order):
    q, image = cloud(60)
    block = np.repeat([2, 0, 1, 5, 4, 3], 10)
    exp = scattered(np.cumsum(q, axis=0), image, block=block).assign_attrs(order=order)
    data = samples(exp)
    for learn, predict in data.folds(3):
        assert not {*data.block[learn].tolist()} & {*data.block[predict].tolist()}
    both, held = pairs(exp).held_out(0.4)
    assert 0 < held.sum() < len(held)
    blocks = np.array([{tuple(a): b for a, b in zip(exp.q.values[0].tolist(), block.tolist(), strict=True)}[tuple(row)]
                       for row in exp.q.values[0].tolist()])  # fmt: skip
    known = torch.from_numpy(exp.q.values[0])

    def of(rows):
        middle = order == "scattered"
        ends = [rows.q - rows.dq / 2, rows.q + rows.dq / 2] if middle else [rows.q, rows.q + rows.dq]
        return {int(blocks[int((known - end).abs().amax(1).argmin())]) for end in torch.cat(ends)}

    assert not of(both.only(held)) & of(both.only(~held))


def test_a_stream_without_blocks_is_held_out_by_arcs(circle):
    exp = bk.experience(circle)
    data = pairs(exp)
    learn, predict = next(iter(data.folds(5)))
    assert torch.equal(predict.q, data.q[: len(predict.q)])
    assert torch.equal(learn.q, data.q[len(predict.q) :])


def test_a_single_block_cannot_be_held_out():
    exp = scattered(*cloud(30), block=np.zeros(30, dtype=int))
    with pytest.raises(InvalidRecording, match="give the estimator its penalty"):
        estimators.Ridge().fit(exp)
    estimators.Ridge(1e-6).fit(exp)
    estimators.ForwardNetwork(hidden=(3,), steps=2).fit(exp)


def test_the_fold_of_each_row_travels_with_it():
    exp = scattered(*cloud(40))
    exp = exp.assign(row=(("trial", "time"), np.arange(40)[None]))
    for one in (exp, exp.drop_vars("block")):
        whole, mixed = fold_of_each(one, 5), fold_of_each(shuffled(one), 5)
        np.testing.assert_array_equal(mixed[0], whole[0][shuffled(one).row.values[0]])
        assert set(whole[0]) == {0, 1, 2, 3, 4}


def test_what_an_ensemble_misses_are_blocks(monkeypatch):
    exp = scattered(*cloud(50))
    given_ = []
    spec = estimators.Ensemble(estimators.Ridge(1e-6), members=3, missing=0.4)
    monkeypatch.setattr(estimators.Ridge, "fit_many", lambda self, experiences, seeds: given_.extend(experiences) or [
        self.fit(one, seed) for one, seed in zip(experiences, seeds, strict=True)])  # fmt: skip
    spec.fit(exp)
    for one in given_:
        hidden = np.isnan(one.hand_image.values).any(-1)[0]
        assert len(set(exp.block.values[0][hidden])) == 2
        assert not set(exp.block.values[0][hidden]) & set(exp.block.values[0][~hidden])
    assert xr.testing.assert_identical(exp, scattered(*cloud(50))) is None
