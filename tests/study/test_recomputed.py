"""A study recomputes itself: every score of every cell again, from public functions and the rule of its streams alone.

Felt and true differ here (noisy encoders, noisy images), so that a score that takes one for the other is another score;
seeds differ, so that two cells that share a stream are found out.
"""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.body_image import BodyImage, PostureSOM, integrate
from bodyimage_kin.study import SCORES, Simulation, Study
from bodyimage_kin.study.doubt import DOUBT
from bodyimage_kin.study.scores import HELD_OUT

ENCODER, IMAGE = 2e-3, 5e-4
SEEDS, ENTROPY = (3, 8), 7
CIRCLE, TOUCH, TOUR = {"turns": 1.0}, {"duration": 20.0}, {"speed": 0.2}
NOISE = bk.Noise(encoder=ENCODER, image=IMAGE)
ESTIMATORS = {"rational": bk.estimators.RationalTrig(), "paper": bk.estimators.PaperMLP(steps=30)}
PROBES = ("training", "in_front", "on_face", "joint_space")
JOINT_SPACE = 60
OF_DOUBT = {one.name for one in DOUBT}
"""Recomputed in test_doubt_scores.py."""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    study = Study(
        "infant",
        recordings={
            "noisy": Simulation(
                bk.motions.Circle(**CIRCLE),
                bk.motions.RandomTouch(**TOUCH),
                bk.motions.FaceTour(**TOUR),
                dynamics=False,
                noise=NOISE,
            )
        },
        estimators=ESTIMATORS,
        probes={**{name: name for name in PROBES[:3]}, "joint_space": bk.probes.JointSpace(JOINT_SPACE)},
        seeds=list(SEEDS),
        block=2,
        seed=ENTROPY,
        scores=[name for name in SCORES if name not in OF_DOUBT],
        per_posture=True,
        first_maps=2,
    )
    found = study.run(tmp_path_factory.mktemp("recomputed"), "in-process")
    assert (found["failure"] == "").all()
    return found.squeeze(["embodiment", "recording"])


def stream(name, count=1):
    """The rule: the study's SeedSequence, spawned by the name of what is drawn."""
    key = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    return [int(one) for one in np.random.SeedSequence(ENTROPY, spawn_key=key.tolist()).generate_state(count)]


class Recomputed:
    """One seed's recordings, and what each estimator learns from them, as a user would compute them."""

    def __init__(self, body, seed):
        self.body, self.seed = body, seed
        circle, touch, tour = stream(f"infant/noisy/{seed}", 3)
        self.circle = bk.simulate(body, bk.motions.Circle(**CIRCLE), circle, dynamics=False, noise=NOISE)
        self.touch = bk.simulate(body, bk.motions.RandomTouch(**TOUCH), touch, dynamics=False, noise=NOISE)
        self.tour = bk.simulate(body, bk.motions.FaceTour(**TOUR), tour, dynamics=False, noise=NOISE)
        everywhere = range(body.skin.count)
        self.probes = {
            "training": torch.from_numpy(self.circle["true_q"].values[0]),
            "in_front": body.touch_postures(everywhere, distance=0.03),
            "on_face": body.touch_postures(everywhere),
        }
        drawn = body.felt_robot.sample(400, seed=0)
        seen = body.hand_in_camera(drawn)[:, 2] >= body.camera.screen.near
        self.probes["joint_space"] = drawn[seen][:JOINT_SPACE]
        self.true = {probe: body.hand_image_jacobian(q).numpy() for probe, q in self.probes.items()}
        # The metric is of what is felt, which is all that the robot knows.
        steps, use = (np.diff(one["q"].values[0], axis=0) for one in (self.circle, self.touch))
        self.excitation = metrics.excitation(steps, use, "felt", 0.1)
        self.metric = use.T @ use / len(use)
        self.metric += 1e-6 * np.trace(self.metric) / body.p * np.eye(body.p)

    def learned(self, name):
        return ESTIMATORS[name].fit(bk.experience(self.circle), seed=stream(f"infant/noisy/{self.seed}/{name}")[0])

    def map_scores(self, learned):
        felt = bk.experience(self.touch)
        hand = integrate(felt, learned)
        seen = self.circle["hand_image"].values[0]
        bounds = np.stack([seen.min(0), seen.max(0)], axis=1)
        of_posture_map, *first = stream(f"infant/noisy/{self.seed}/first maps", 3)
        touching = felt["q"].values[0][felt["touched"].values[0, :, 0] >= 0]
        som = PostureSOM.fit(touching, (8, 8), of_posture_map)
        truth = self.body.hand_image(self.probes["on_face"]).numpy().reshape(21, 21, 2)
        asked = {"skin": (21, 21), "image_range": bounds, "posture_som": som}
        found = []
        for seed in first:
            maps = BodyImage.learn(felt, hand, seed=seed, **asked)
            direct = BodyImage.learn(felt, self.touch["true_hand_image"], seed=seed, **asked)
            of = metrics.scores(maps.tactile_map, truth)
            found.append(
                {
                    "map_error_to_truth": rms(maps.tactile_map - truth),
                    "map_topological_error": of["topological_error"],
                    "map_span": of["span"],
                    "map_disparity": of["disparity"],
                    "map_folded_cells": of["folded_cells"],
                    "map_error": rms(maps.tactile_map - direct.tactile_map) / extent(direct.tactile_map),
                    "posture_map_error": rms(maps.posture_map - direct.posture_map) / extent(direct.posture_map),
                }
            )
        means = {key: np.mean([one[key] for one in found], axis=0) for key in found[0]}
        return means | {"touch_trajectory_rmse": rms(hand.values - self.touch["true_hand_image"].values)}


def rms(difference):
    return np.sqrt((np.asarray(difference) ** 2).sum(-1).mean())


def extent(values):
    return rms(values - values.mean((0, 1)))


@pytest.fixture(scope="module", params=SEEDS)
def again(request, body):
    return Recomputed(body, request.param)


@pytest.fixture(params=ESTIMATORS)
def pair(request, again, results):
    """What a study says of one estimator and seed, the same computed again, and the estimator."""
    return results.sel(estimator=request.param, seed=again.seed), again, again.learned(request.param)


def close(found, wanted, rtol=1e-9):
    np.testing.assert_allclose(np.asarray(found), wanted, rtol=rtol, atol=1e-15)


def test_every_score_is_recomputed_somewhere(results):
    recomputed = {
        "relative_error", "relative_error_use", "relative_error_moved", "scale_free_error", "attribution",
        "best_scale", "scale_along_truth",
        "relative_error_by_posture", "scale_free_error_by_posture", "critical_gain_by_posture",
        "scale_by_posture", "variation_by_posture", "basin_by_posture",
        "displacement_error", "velocity_correlation", "velocity_nrmse", "trajectory_rmse", "trajectory_split",
        "touch_trajectory_rmse", "map_error", "map_error_to_truth", "map_topological_error", "map_span",
        "map_disparity", "map_folded_cells", "posture_map_error",
    }  # fmt: skip
    measured_only = {"fit_seconds"}
    held_against_bk_score = set(HELD_OUT)  # in test_held_out_scores.py
    assert set(SCORES) == recomputed | measured_only | held_against_bk_score | OF_DOUBT
    assert set(SCORES) - OF_DOUBT <= set(results.data_vars)


@pytest.mark.parametrize("probe", PROBES)
def test_scores_at_a_probe(pair, probe):
    one, again, learned = pair
    q, J, W = again.probes[probe], again.true[probe], again.metric
    Jh = learned.jacobian(q).detach().numpy()
    E = Jh - J

    def size(A, metric=None):
        return np.einsum("nij,jk,nik->n", A, np.eye(len(W)) if metric is None else metric, A)

    at = one.sel(probe=probe)
    close(at["relative_error"], np.sqrt(size(E).sum() / size(J).sum()))
    close(at["relative_error_use"], np.sqrt(size(E, W).sum() / size(J, W).sum()), rtol=1e-6)
    inner = np.einsum("nij,jk,nik->", Jh, W, J)
    scale = inner / size(Jh, W).sum()
    close(at["best_scale"], scale, rtol=1e-6)
    close(at["scale_along_truth"], (1 - inner / size(J, W).sum()) ** 2, rtol=1e-6)
    close(at["scale_free_error"], 1 - inner**2 / (size(Jh, W).sum() * size(J, W).sum()), rtol=1e-6)
    parts = at["attribution"]
    close(parts.sum("part"), size(E, W).sum() / size(J, W).sum(), rtol=1e-6)
    close(parts[0], (1 - scale) ** 2 * size(Jh, W).sum() / size(J, W).sum(), rtol=1e-6)
    residual = scale * Jh - J
    deviation = residual - residual.mean(0)
    close(parts[-1], size(deviation, W).sum() / size(J, W).sum(), rtol=1e-6)
    n = len(q)
    by_posture = at.isel(posture=slice(n))
    assert at["relative_error_by_posture"].isel(posture=slice(n, None)).isnull().all()
    close(by_posture["relative_error_by_posture"], np.sqrt(size(E, W) / size(J, W)), rtol=1e-6)
    close(by_posture["variation_by_posture"], size(deviation, W) / size(J, W).mean(), rtol=1e-6)
    close(by_posture["scale_by_posture"], (1 - scale) ** 2 * size(Jh, W) / size(J, W).mean(), rtol=1e-6)
    free = 1 - np.einsum("nij,jk,nik->n", Jh, W, J) ** 2 / (size(Jh, W) * size(J, W))
    np.testing.assert_allclose(by_posture["scale_free_error_by_posture"], free, rtol=1e-5, atol=1e-9)
    gain = metrics.critical_gain(metrics.servo_matrix(J, Jh))
    close(by_posture["critical_gain_by_posture"], gain)


def test_the_error_in_the_directions_that_moved(pair):
    one, again, learned = pair
    q, J = again.probes["training"].numpy(), again.true["training"]
    Jh = learned.jacobian(torch.from_numpy(q)).detach().numpy()
    spectrum = metrics.local_spectrum(q, noise=ENCODER)
    moved = metrics.pooled_relative_error(spectrum.restrict(J), spectrum.restrict(Jh))
    close(one["relative_error_moved"], moved)
    assert moved != pytest.approx(float(one["relative_error"].sel(probe="training")))


def test_scores_of_displacements_and_of_the_path_they_sum_to(pair):
    one, again, learned = pair
    q, image = torch.from_numpy(again.tour["true_q"].values[0]), again.tour["true_hand_image"].values[0]
    dq = q.diff(dim=0)
    true = (again.body.hand_image_jacobian(q[:-1]) @ dq[..., None])[..., 0].numpy()
    foreseen = learned.displacement(q[:-1], dq).detach().numpy()
    close(one["displacement_error"], rms(foreseen - true) / rms(true))
    # The path is integrated from what is felt, from the true place it begins at.
    felt = torch.from_numpy(again.tour["q"].values[0])
    steps = learned.displacement(felt[:-1], felt.diff(dim=0)).detach().numpy()
    path = image[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    close(one["trajectory_rmse"], rms(path - image))
    velocity, estimated = np.diff(image, axis=0), np.diff(path, axis=0)
    for axis in (0, 1):
        v, e = velocity[:, axis], estimated[:, axis]
        close(one["velocity_correlation"][axis], np.corrcoef(v, e)[0, 1])
        close(one["velocity_nrmse"][axis], np.sqrt(((v - e) ** 2).mean()) / np.ptp(v))
    split = metrics.error_split(
        q.numpy(),
        image,
        lambda at, step: learned.displacement(torch.from_numpy(at), torch.from_numpy(step)).detach().numpy(),
        lambda at: learned.jacobian(torch.from_numpy(at)).detach().numpy(),
    )
    close(one["trajectory_split"], list(split.rms.values())[:3])


def test_scores_of_maps(pair):
    one, again, learned = pair
    for name, value in again.map_scores(learned).items():
        np.testing.assert_allclose(one[name], value, rtol=1e-9, atol=1e-12, err_msg=name)


def test_the_basin(pair):
    one, again, learned = pair
    some = [0, 220, 440]
    basin = metrics.servo_basin(
        lambda at: again.body.hand_image(torch.from_numpy(at), on_invisible="nan").numpy(),
        lambda at: again.body.hand_image_jacobian(torch.from_numpy(at)).numpy(),
        lambda at: learned.jacobian(torch.from_numpy(at)).detach().numpy(),
        again.probes["on_face"][some].numpy(),
        lower=again.body.felt_robot.lower,
        upper=again.body.felt_robot.upper,
    )
    np.testing.assert_array_equal(one["basin_by_posture"].sel(probe="on_face", posture=some), basin.radius)


def test_facts_of_the_recording(results, again, body):
    one = results.sel(seed=again.seed)
    np.testing.assert_allclose(one["excitation"], again.excitation.eigenvalues, rtol=1e-9)
    seen = again.circle["true_q"].values[0]
    covariance = np.cov(seen.T, bias=True)
    covariance += 1e-6 * np.trace(covariance) / body.p * np.eye(body.p)
    places = body.hand_position(torch.from_numpy(seen)).numpy()
    for probe, q in again.probes.items():
        away = q.numpy() - seen.mean(0)
        mahalanobis = np.sqrt(np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away))
        close(one["mahalanobis_distance"].sel(probe=probe), mahalanobis.mean(), rtol=1e-6)
        here = body.hand_position(q).numpy()
        nearest = np.linalg.norm(here[:, None] - places[None], axis=-1).min(1)
        np.testing.assert_allclose(one["hand_distance"].sel(probe=probe), nearest.mean(), rtol=1e-9, atol=1e-12)
