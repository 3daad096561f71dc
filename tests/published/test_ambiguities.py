"""The readings of what the paper leaves open: one small study, and two of its readings from public functions."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.body_image import PostureSOM
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.published import ambiguities
from bodyimage_kin.published.ambiguities import AMBIGUITIES, Network, Secant
from bodyimage_kin.recordings import first_taxel
from bodyimage_kin.study.random_streams import stream

COMMITTED = Path(__file__).parents[2] / "comparisons" / "ambiguities"
SEED, DURATION = 4, 20.0
SOME = ("jacobian", "silence", "noise")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("ambiguities")


@pytest.fixture(scope="module")
def results(folder):
    return ambiguities.grid([SEED], DURATION, SOME).run(folder, "in-process")


@pytest.fixture(scope="module")
def found(results):
    return ambiguities.judge(results, SOME)


@pytest.fixture(scope="module")
def circle():
    return bk.experience(bk.simulate(bk.load_embodiment("infant"), bk.motions.Circle(turns=1.0), 3, dynamics=False))


class Again:
    """The recordings of a reading, and what is drawn at random for it."""

    def __init__(self, folder, recording):
        self.body = bk.load_embodiment("infant")
        roles = ("training", "use", "tour")
        self.seen, self.use, self.tour = (bk.study.recording_of(folder, recording, SEED, one) for one in roles)
        base = f"infant/ambiguities/{SEED}"
        self.fit_seed = stream(0, f"{base}/ambiguities")[0]
        self.map_seeds = stream(0, f"{base}/first maps", 2)

    def network(self, steps):
        return bk.estimators.PaperMLP(steps=steps).fit(bk.experience(self.seen), self.fit_seed)

    def displacement_error(self, learned):
        q = torch.from_numpy(self.use["true_q"].values[0])
        dq = q[1:] - q[:-1]
        true = (self.body.hand_image_jacobian(q[:-1]) @ dq[..., None])[..., 0]
        return bk.metrics.displacement_error(learned.displacement(q[:-1], dq).numpy(), true.numpy())

    def tour_error(self, learned):
        true = self.tour["true_hand_image"].values
        path = bk.integrate(bk.experience(self.tour), learned, reset="none", initial=true[:, 0])
        return 1e3 * bk.metrics.trajectory_rmse(true, path.values)

    def map(self, learned, **settings):
        felt, image = bk.experience(self.use), self.seen["hand_image"].values.reshape(-1, 2)
        touching = felt["q"].values[0][first_taxel(felt)[0] >= 0]
        settings |= {
            "seed": self.map_seeds[1],
            "image_range": np.stack([np.nanmin(image, axis=0), np.nanmax(image, axis=0)], axis=1),
            "posture_som": PostureSOM.fit(touching, (8, 8), self.map_seeds[0]),
        }
        return bk.BodyImage.learn(felt, bk.integrate(felt, learned), **settings).tactile_map

    def scores(self, learned, **settings):
        skin = self.body.skin
        truth = self.body.hand_image(self.body.touch_postures(np.arange(skin.count))).numpy().reshape(*skin.shape, 2)
        return bk.metrics.scores(self.map(learned, **settings), truth)


def rounded(value):
    return pytest.approx(value, rel=6e-4)


def test_a_reading_with_noisy_joints_is_what_public_functions_give(folder, found):
    again = Again(folder, "noise_of_joints_0.01_rad")
    learned = again.network(500)
    moved = np.linalg.svd(np.diff(again.seen["q"].values[0], axis=0), compute_uv=False)
    touched = bk.integrate(bk.experience(again.use), learned)
    of = {name: one[0] for name, one in found["values"]["noise"]["joint angles, 0.01 rad"]["noise"].items()}
    assert of == {
        "excitation": rounded(moved[-1] / moved[0]),
        "displacement": rounded(again.displacement_error(learned)),
        "tour": rounded(again.tour_error(learned)),
        "topological": rounded(again.scores(learned)["topological_error"]),
        "touch": rounded(1e3 * bk.metrics.trajectory_rmse(again.use["true_hand_image"].values, touched.values)),
        "span": rounded(again.scores(learned)["span"].mean()),
    }


def test_a_reading_of_silence_is_what_public_functions_give(folder, found):
    again = Again(folder, "noise_without_silence")
    assert (again.use["touched"].values == again.use["true_touched"].values).all()
    of = again.scores(again.network(500), silence=0.2, silence_mode="taxel")
    judged = found["values"]["silence"]["each taxel by itself, 20%"]["noise"]
    assert judged["disparity"] == [rounded(of["disparity"])]
    assert judged["span"] == [rounded(of["span"].mean())]


def test_the_secant_is_told_the_felt_motion(folder, found):
    again = Again(folder, "kinematic")
    dq = np.diff(again.use["q"].values[0], axis=0)
    secant = again.network(200).secant(torch.from_numpy(dq))
    constant = bk.estimators.ConstantJacobian(secant.contiguous())
    judged = found["values"]["jacobian"]["its secant over the touching motion"]["kinematic"]
    assert judged["displacement"] == [rounded(again.displacement_error(constant))]
    with pytest.raises(InvalidConfig, match="motion=None; tell it"):
        Secant().fit(bk.experience(again.seen))


def test_readings_are_paired(folder):
    usual, spoken, unpushed = (
        Again(folder, name).use for name in ("noise", "noise_without_silence", "noise_of_joints_0.01_rad")
    )
    assert (usual["true_q"].values == spoken["true_q"].values).all()
    assert (usual["touched"].values != spoken["touched"].values).any()
    # Without torques the arm moves a little otherwise, but the hand is led the same way.
    apart = np.abs(usual["true_hand_position"].values - unpushed["true_hand_position"].values).max()
    assert 0 < apart < 5e-3


def test_every_reading_stands_in_the_study_once():
    study = ambiguities.grid(1)
    for place in ambiguities.places():
        row = study.estimators[place.name]
        assert f"{place.embodiment}/{place.recording}" in row["on"]
        assert place.embodiment in study.embodiments
        assert place.recording in study.recordings
    assert set(study.recordings) == set(ambiguities.recordings())
    assert {one.key for one in ambiguities.places()} == set(ambiguities.ROWS)
    for ambiguity in AMBIGUITIES.values():
        for motion in ambiguity.motions:
            stand = [reading.place(motion) for reading in ambiguity.readings]
            assert len(set(stand)) == len(stand)


def test_a_study_is_a_file_too(tmp_path):
    study = ambiguities.grid(2, DURATION)
    study.to_toml(tmp_path / "study.toml")
    read = bk.Study.from_toml(tmp_path / "study.toml")
    assert read.estimators == study.estimators
    assert read.recordings == study.recordings


def test_the_network_with_its_defaults_is_that_of_the_package(circle):
    ours, theirs = (spec(steps=50).fit(circle, 7) for spec in (bk.estimators.PaperMLP, Network))
    q = torch.from_numpy(circle["q"].values[0])
    dq = q[1:] - q[:-1]
    torch.testing.assert_close(theirs.displacement(q[:-1], dq), ours.displacement(q[:-1], dq), rtol=1e-9, atol=1e-15)
    torch.testing.assert_close(theirs.jacobian(q), ours.jacobian(q), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("setting", "value"), [("depth", 0), ("unit", "relu"), ("scaling", "max"), ("update", "batch"), ("steps", -1)]
)
def test_a_network_refuses_what_it_cannot_be(setting, value):
    with pytest.raises(InvalidConfig, match=setting):
        Network(**{setting: value})


def test_of_one_network_the_jacobians_differ_as_they_say(circle):
    network = bk.estimators.PaperMLP(steps=50)
    own = network.fit(circle, 7)
    unbiased, at_zero = (spec(network).fit(circle, 7) for spec in (ambiguities.Unbiased, ambiguities.AtZero))
    q, rest = torch.from_numpy(circle["q"].values[0]), torch.zeros(5, dtype=torch.float64)
    assert (unbiased.displacement(q[0], rest) == 0).all()
    assert (own.displacement(q[0], rest) != 0).all()
    torch.testing.assert_close(unbiased.jacobian(q), own.jacobian(q))
    torch.testing.assert_close(at_zero.jacobian(q), own.jacobian(q))
    assert (at_zero.displacement(q[0], rest) == 0).all()


def test_the_bound_is_the_mean_over_taxels(circle):
    body = bk.load_embodiment("infant")
    true = body.hand_image_jacobian(body.touch_postures(np.arange(body.skin.count)))
    learned = ambiguities.FaceMean(body).fit(circle)
    torch.testing.assert_close(learned.matrix, true.mean(0))


def test_another_arm_is_longer_and_nothing_else():
    usual, longer = bk.load_embodiment("infant"), ambiguities.infant_with_arm(1.15)
    for joint, other in zip(usual.robot.path("left_hand"), longer.robot.path("left_hand"), strict=True):
        factor = 1.15 if joint.name in ("left_elbow", "left_wrist") else 1.0
        np.testing.assert_allclose(other.origin[:3, 3], factor * np.asarray(joint.origin[:3, 3]))
        np.testing.assert_array_equal(other.origin[:3, :3], joint.origin[:3, :3])
    for link in ("right_hand", "head", "right_eye"):
        assert [one.origin.tolist() for one in usual.robot.path(link)] == [
            one.origin.tolist() for one in longer.robot.path(link)
        ]
    with pytest.raises(InvalidConfig, match="factor=0"):
        ambiguities.infant_with_arm(0)


def test_an_ambiguity_that_there_is_not_is_named():
    with pytest.raises(UnknownName, match="no ambiguity 'kernle'; did you mean 'kernel'"):
        ambiguities.grid(1, ambiguities=["kernle"])
    with pytest.raises(InvalidConfig, match="at least one name"):
        ambiguities.grid(1, ambiguities="kernel")


def test_a_network_that_diverges_is_counted_and_any_other_failure_refused(results):
    at = {"embodiment": "infant", "recording": "kinematic", "estimator": "unbiased_200", "seed": SEED}
    for failure in ("WrongResult: the integrated tour is not finite in 3 of 9 postures", "MemoryError: no"):
        wrong = results.copy(deep=True)
        wrong["failure"] = wrong["failure"].astype(object)
        wrong["failure"].loc[at] = failure
        for name in ("touch_displacement_error", "trajectory_rmse"):
            wrong[name].loc[at] = np.nan
        if failure.startswith("Memory"):
            with pytest.raises(InvalidConfig, match=r"1 cells failed, kinematic/unbiased_200 first: MemoryError: no"):
                ambiguities.judge(wrong, SOME)
        else:
            judged = ambiguities.judge(wrong, SOME)
            one = judged["summary"]["jacobian"]["f(dq) - f(0)"]["kinematic"]["displacement"]
            assert (one["mean"], one["diverged"]) == (None, 1)
            table = ambiguities.markdown({**judged, "command": "run"})
            assert "| f(dq) - f(0) | diverges |" in table


def test_the_page_is_made_of_the_results_that_are_kept():
    kept = json.loads((COMMITTED / "results.json").read_text(encoding="utf-8"))
    assert ambiguities.markdown(kept) == (COMMITTED / "table.md").read_text(encoding="utf-8")
    assert kept["measures"] == {name: list(one.measures) for name, one in AMBIGUITIES.items()}
    for name, one in AMBIGUITIES.items():
        assert list(kept["values"][name]) == [reading.name for reading in one.readings]
        assert all(tuple(found) == one.motions for found in kept["values"][name].values())


def test_what_is_judged_has_the_form_of_what_is_kept(found, tmp_path):
    kept = json.loads((COMMITTED / "results.json").read_text(encoding="utf-8"))

    def form(values):
        return {r: {m: set(one) for m, one in found.items()} for r, found in values.items()}

    for name in SOME:
        assert form(found["values"][name]) == form(kept["values"][name])
        assert form(found["summary"][name]) == form(kept["summary"][name])
    assert kept.keys() - found.keys() == {"command"}
    ambiguities.write_summary({"command": "run", **found}, tmp_path)
    assert json.loads((tmp_path / "results.json").read_text()) == {"command": "run", **found}
    assert (found["seeds"], found["duration"]) == (1, DURATION)


def test_rows_learn_under_the_settings_that_they_are_called_by():
    for key, row in ambiguities.ROWS.items():
        if not isinstance(row, bk.study.Row):
            assert row(11).estimator != row(12).estimator, key
    library = ambiguities.ROWS["network"](200)
    for key in ("kernel_mm", "no_reset", "silent_taxels"):
        other = ambiguities.ROWS[key](200)
        assert dataclasses.replace(other, maps={}, reset="reference") == library
