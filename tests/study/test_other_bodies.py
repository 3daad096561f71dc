"""Estimators of a study that know another body than the one that is studied."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import Analytic, Conformal, SelfCalibration
from bodyimage_kin.recordings.motions import Circle
from bodyimage_kin.study import Study
from bodyimage_kin.study.specs import ESTIMATOR

CALIBRATION = {"spec": {"SelfCalibration": {"steps": 3}}}


@pytest.fixture(scope="module")
def nominal(body):
    """The infant with its hand's point a centimetre off."""
    return replace(body, name="nominal", hand=replace(body.hand, offset=body.hand.offset + torch.tensor([0.01, 0, 0])))


@pytest.fixture(scope="module")
def folder(nominal, tmp_path_factory):
    place = tmp_path_factory.mktemp("nominal")
    (place / "nominal.toml").write_text(nominal.to_toml(), encoding="utf-8")
    return place


def study(folder, *estimators):
    named = dict(zip("abcd", estimators, strict=False))
    motion = {"circle": Circle(turns=0.2)}
    return Study("infant", motion, named, seeds=1, scores=["relative_error"], probes=["on_face"], folder=folder)


def test_a_row_that_names_a_body_is_given_that_one(folder, nominal, body, tmp_path):
    one = study(folder, {"Analytic": {"body": "nominal.toml"}}, {"Analytic": {"body": "infant"}}, "Analytic")
    assert one.estimators["a"] == {"Analytic": {"body": "nominal.toml"}}
    found = one.run(tmp_path / "store", "in-process")["relative_error"].squeeze()
    q = body.touch_postures(range(body.skin.count))
    expected = bk.metrics.pooled_relative_error(body.hand_image_jacobian(q), nominal.hand_image_jacobian(q))
    assert expected > 0.05
    assert found.sel(estimator="a").item() == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(found.sel(estimator=["b", "c"]), 0.0, atol=1e-12)


def test_what_it_is_made_of_belongs_to_the_study(folder, nominal):
    origin = study(folder, {"Analytic": {"body": "nominal.toml"}}).origin()
    assert origin["other_bodies_sha256"] == [nominal.sha256]
    assert "other_bodies_sha256" not in study(folder, "Analytic").origin()


def test_a_body_within_another_estimator_is_named_as_well(folder, nominal, body):
    built = ESTIMATOR.build({"Misinformed": {"spec": {"SelfCalibration": {"body": "nominal.toml"}}}}, folder, body)
    assert built.spec.body == nominal
    assert ESTIMATOR.build({"Misinformed": CALIBRATION}, folder, body).spec.body is body


def test_an_object_of_another_body_is_refused_and_not_handed_the_truth(folder, nominal, body):
    for estimator in (SelfCalibration(nominal), Conformal(Analytic(nominal)), bk.study.Row(Analytic(nominal))):
        with pytest.raises(InvalidConfig, match=r"row 'a' was built with the body 'nominal', which is none.*name it"):
            study(folder, estimator)
    assert study(folder, SelfCalibration(body)).estimators["a"]["SelfCalibration"]["steps"] == 100


@pytest.mark.parametrize("name", [3, ["infant"], {"Analytic": {}}])
def test_a_body_is_named_by_text(folder, name):
    with pytest.raises(InvalidConfig, match="Analytic: body"):
        study(folder, {"Analytic": {"body": name}})


def test_a_body_that_is_not_there_is_said(folder):
    with pytest.raises(InvalidConfig, match=r"missing.toml"):
        study(folder, {"Analytic": {"body": "missing.toml"}}).origin()
