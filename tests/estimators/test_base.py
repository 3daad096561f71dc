"""What all estimators have in common: what they learn from, shapes, derivatives, files."""

import dataclasses
import json

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidRecording, UnknownName
from bodyimage_kin.estimators import Analytic, LeastSquares, PaperMLP, pairs

SPECS = [LeastSquares(), PaperMLP(steps=30)]
TRIG, NEAR = bk.estimators.TrigRidge(degree=1), bk.estimators.NearestNeighbours()
DEEP = bk.estimators.ForwardNetwork(hidden=(4,), steps=2)


# Pairs ----------------------------------------------------------------------------------------------------------------


def test_pairs_are_the_steps_felt_and_seen_at_both_ends(circle):
    exp = bk.experience(circle).isel(time=slice(0, 8)).copy(deep=True)
    exp.hand_image[0, 2] = np.nan
    exp.q[0, 5, 1] = np.nan
    data = pairs(exp)
    kept = [0, 3, 6]
    q, image = exp.q.values[0], exp.hand_image.values[0]
    np.testing.assert_array_equal(data.q.numpy(), q[kept])
    np.testing.assert_array_equal(data.dq.numpy(), q[[i + 1 for i in kept]] - q[kept])
    np.testing.assert_array_equal(data.dr.numpy(), image[[i + 1 for i in kept]] - image[kept])


def test_no_step_leads_from_one_trial_to_the_next(circle):
    import xarray as xr

    exp = bk.experience(circle)
    parts = [exp.isel(time=slice(i, i + 4)).drop_vars("time") for i in (0, 10)]
    both = xr.concat(parts, dim="trial", data_vars="different", coords="different", compat="equals", join="override")
    assert len(pairs(both).dq) == 6


@pytest.mark.parametrize("spec", SPECS)
def test_nothing_to_learn_from_is_said(spec, circle, touch):
    exp = bk.experience(circle)
    with pytest.raises(InvalidRecording, match="no two successive samples in which the hand is seen"):
        spec.fit(bk.experience(touch))
    with pytest.raises(InvalidRecording, match="no two successive samples"):
        spec.fit(exp.isel(time=slice(0, 1)))
    with pytest.raises(InvalidRecording, match="no samples"):
        spec.fit(exp.isel(time=slice(0, 0)))
    with pytest.raises(InvalidRecording, match="no joint moves"):
        spec.fit(exp.assign(q=exp.q.copy(data=np.zeros(exp.q.shape))))
    with pytest.raises(InvalidRecording, match="no variable 'hand_image'"):
        spec.fit(exp.drop_vars("hand_image"))


# Every learned Jacobian -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("batch", [(), (0,), (2, 0, 3), (2, 3)])
@pytest.mark.parametrize("spec", SPECS)
def test_shapes_and_dtypes(spec, circle, batch):
    learned = spec.fit(bk.experience(circle))
    assert (learned.p, learned.m) == (5, 2)
    q = torch.zeros(*batch, 5, dtype=torch.float64)
    assert learned.displacement(q, q).shape == (*batch, 2)
    assert learned.jacobian(q).shape == (*batch, 2, 5)
    assert learned.displacement(q, torch.zeros(5, dtype=torch.float64)).shape == (*batch, 2)
    single = q.float()
    assert learned.displacement(single, single).dtype == learned.jacobian(single).dtype == torch.float32
    assert torch.equal(learned.displacement(q.numpy(), q), learned.displacement(q, q))


@pytest.mark.parametrize("spec", SPECS)
def test_bad_postures_are_refused(spec, circle):
    learned = spec.fit(bk.experience(circle))
    for q, dq in (([0.0] * 4, [0.0] * 5), ([0.0] * 5, [0.0] * 4), ([[0.0] * 5] * 2, [[0.0] * 5] * 3), ("q", [0.0] * 5)):
        with pytest.raises(InvalidPosture):
            learned.displacement(q, dq)
    with pytest.raises(InvalidPosture):
        learned.jacobian([0.0] * 4)


def test_the_jacobian_is_the_derivative_of_the_displacement(circle, body):
    exp = bk.experience(circle)
    q = torch.from_numpy(circle.true_q.values[0, ::20])
    for spec in (*SPECS, Analytic(body)):
        learned = spec.fit(exp)
        for posture in q:
            auto = torch.func.jacrev(learned.displacement, argnums=1)(posture, torch.zeros(5, dtype=torch.float64))
            torch.testing.assert_close(learned.jacobian(posture), auto, atol=1e-15, rtol=1e-12)

    # What a family without a closed form gets.
    learned = PaperMLP(steps=30).fit(exp)
    shared = bk.estimators.LearnedJacobian._jacobian(learned, q)
    torch.testing.assert_close(shared, learned.jacobian(q), atol=1e-15, rtol=1e-12)


@pytest.mark.parametrize("spec", SPECS)
def test_what_is_handed_out_can_be_changed_without_harm(spec, circle):
    learned = spec.fit(bk.experience(circle))
    q = torch.zeros(3, 5, dtype=torch.float64)
    before = learned.jacobian(q).clone()
    learned.jacobian(q).fill_(7.0)
    assert torch.equal(learned.jacobian(q), before)


@pytest.mark.parametrize("spec", SPECS)
def test_learning_is_pure(spec, circle):
    exp = bk.experience(circle)
    kept, state = exp.copy(deep=True), torch.get_rng_state()
    one, again = spec.fit(exp, seed=3), spec.fit(exp, seed=3)
    assert exp.identical(kept)
    assert torch.equal(torch.get_rng_state(), state)
    for name, array in one.arrays().items():
        assert torch.equal(array, again.arrays()[name])
    # The truth beside it changes nothing.
    for name, array in spec.fit(circle, seed=3).arrays().items():
        assert torch.equal(array, one.arrays()[name])


@pytest.mark.parametrize("spec", SPECS)
def test_many_at_once_are_the_same_as_one_by_one(spec, circle):
    exp = bk.experience(circle)
    half = exp.isel(time=slice(0, 60))
    many = spec.fit_many([exp, half, exp], [1, 1, 2])
    for learned, single in zip(many, [spec.fit(exp, 1), spec.fit(half, 1), spec.fit(exp, 2)], strict=True):
        for name, array in learned.arrays().items():
            assert torch.equal(array, single.arrays()[name])
    assert spec.fit_many([], []) == []
    with pytest.raises(InvalidConfig, match="2 experiences and 1 seeds"):
        spec.fit_many([exp, exp], [1])


def test_specs_are_frozen_and_say_what_they_are(body):
    assert set(bk.estimators.names()) >= {"LeastSquares", "PaperMLP", "Analytic"}
    assert all(hasattr(bk.estimators, name) for name in bk.estimators.names())
    for spec in (*SPECS, Analytic(body)):
        assert isinstance(spec, bk.estimators.Estimator)
        with pytest.raises(dataclasses.FrozenInstanceError):
            spec.steps = 3
    assert PaperMLP(steps=200) == PaperMLP()
    assert hash(PaperMLP()) == hash(PaperMLP(steps=200))
    assert LeastSquares() == LeastSquares()


# Files ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spec", SPECS)
def test_a_learned_jacobian_comes_back_to_the_bit(spec, circle, tmp_path):
    learned = spec.fit(bk.experience(circle), seed=1)
    folder = tmp_path / "deep" / "folder"
    learned.save(folder)
    again = bk.load_learned(str(folder))
    assert type(again) is type(learned)
    assert again.arrays().keys() == learned.arrays().keys()
    for name, array in learned.arrays().items():
        assert torch.equal(again.arrays()[name], array)
        assert again.arrays()[name].dtype == array.dtype
    assert sorted(file.name for file in folder.iterdir()) == ["learned.json", "learned.safetensors"]
    learned.save(folder)


def test_a_unit_travels_from_the_recording_to_the_file(circle, tmp_path):
    exp = bk.experience(circle)
    assert LeastSquares().fit(exp).unit == exp.hand_image.attrs["units"] == "m"
    exp = exp.assign(hand_image=exp.hand_image.assign_attrs(units="px"))
    for spec in (*SPECS, bk.estimators.ForwardNetwork(hidden=(3,), steps=2), bk.estimators.nulls.Zero(LeastSquares())):
        assert spec.fit(exp).unit == "px"
    LeastSquares().fit(exp).save(tmp_path)
    assert bk.load_learned(tmp_path).unit == "px"
    assert LeastSquares().fit(exp.assign(hand_image=exp.hand_image.drop_attrs())).unit == ""


def test_sizes_are_read_off_the_fields(circle):
    learned = bk.estimators.TrigRidge(degree=1).fit(bk.experience(circle))
    assert (learned.p, learned.m) == (len(learned.basis.centre), learned.weights.shape[1]) == (5, 2)

    @dataclasses.dataclass(frozen=True, eq=False)
    class Nameless(bk.estimators.LearnedJacobian):
        matrix: torch.Tensor

        def _displacement(self, q, dq):
            return dq

    with pytest.raises(TypeError, match="no field of Nameless has a dimension 'p'"):
        _ = Nameless(torch.zeros(2, 3)).p


def test_the_protocol_is_met_by_ours_and_by_others(circle, body):
    exp = bk.experience(circle)
    for spec in (*SPECS, Analytic(body), bk.estimators.TrigRidge(1)):
        assert isinstance(spec.fit(exp), bk.estimators.Learned)
    assert isinstance(bk.estimators.TrigRidge(1).fit(exp), bk.estimators.LearnedImage)
    assert not isinstance(LeastSquares().fit(exp), bk.estimators.LearnedImage)

    class Foreign:
        p, m = 5, 2

        def displacement(self, q, dq):
            return dq[..., :2]

        def jacobian(self, q):
            return torch.eye(2, 5).expand(*q.shape[:-1], 2, 5)

    assert isinstance(Foreign(), bk.estimators.Learned)
    assert not isinstance(LeastSquares(), bk.estimators.Learned)


def test_prior_knowledge_is_not_saved(body, circle, tmp_path):
    with pytest.raises(InvalidConfig, match="AnalyticJacobian cannot be saved"):
        Analytic(body).fit(bk.experience(circle)).save(tmp_path / "analytic")


def test_files_that_are_not_ours_are_refused(circle, tmp_path):
    def saved(name):
        LeastSquares().fit(bk.experience(circle)).save(tmp_path / name)
        return tmp_path / name

    with pytest.raises(InvalidConfig, match="holds no learned Jacobian"):
        bk.load_learned(tmp_path / "missing")
    for name, file, content in (
        ("json", "learned.json", b"{"),
        ("bytes", "learned.json", b"\xff\xfe"),
        ("list", "learned.json", b"[]"),
        ("kindless", "learned.json", b"{}"),
        ("arrays", "learned.safetensors", b"half"),
        ("empty", "learned.safetensors", b""),
    ):
        folder = saved(name)
        (folder / file).write_bytes(content)
        with pytest.raises(InvalidConfig, match="holds no learned Jacobian"):
            bk.load_learned(folder)
    folder = saved("lacking")
    save_file({"other": torch.zeros(1)}, str(folder / "learned.safetensors"))
    with pytest.raises(InvalidConfig, match="the array 'matrix' is missing"):
        bk.load_learned(folder)
    folder = saved("future")
    description = json.loads((folder / "learned.json").read_text())
    for change in ({"version": 99}, {"format": "another program's"}, {"version": None}):
        (folder / "learned.json").write_text(json.dumps({**description, **change}))
        with pytest.raises(InvalidConfig, match="holds no learned Jacobian that this version reads"):
            bk.load_learned(folder)


@pytest.mark.parametrize(
    ("spec", "change", "said"),
    [
        (LeastSquares(), {"matrix": [2]}, "shape"),
        (LeastSquares(), {"matrix": "[2, 5]"}, "shape"),
        (LeastSquares(), {"unit": 3}, "give a text"),
        (LeastSquares(), {"kind": 3}, "a table with its kind"),
        (TRIG, {"basis": []}, "a table with its kind"),
        (TRIG, {"basis": {"kind": "trigonometric_basis"}}, "basis.centre is missing"),
        (TRIG, {"basis": {"kind": "trigonometric_basis", "centre": [5], "degree": 0}}, "degree"),
        (TRIG, {"basis": {"kind": "trigonometric_basis", "centre": [5], "degree": True}}, "degree"),
        (TRIG, {"basis": {"kind": "trigonometric_basis", "centre": [5], "degree": 2}}, "functions"),
        (TRIG, {"basis": {"kind": "trigonometric_basis", "centre": [5], "degree": 10**30}}, "degree"),
        (TRIG, {"basis": {"kind": ["trigonometric_basis"], "centre": [5], "degree": 2}}, "a table with its kind"),
        (TRIG, {"basis": {"kind": {}, "centre": [5], "degree": 2}}, "a table with its kind"),
        (NEAR, {"neighbours": 10**9}, "neighbours"),
        (NEAR, {"penalty": float("nan")}, "penalty"),
        (NEAR, {"penalty": "1"}, "penalty"),
        (DEEP, {"layers": []}, "list that is not empty"),
        (DEEP, {"layers": [[4, 5], [4], [2, 4]]}, "layers have shapes"),
    ],
)
def test_a_description_that_lies_is_refused(spec, change, said, circle, tmp_path):
    spec.fit(bk.experience(circle)).save(tmp_path)
    description = json.loads((tmp_path / "learned.json").read_text())
    (tmp_path / "learned.json").write_text(json.dumps({**description, **change}))
    with pytest.raises(InvalidConfig, match="holds no learned Jacobian") as caught:
        bk.load_learned(tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (torch.zeros(10, dtype=torch.float64), "it must be (m, p)"),
        (torch.zeros(2, 0, dtype=torch.float64), "empty"),
        (torch.full((2, 5), torch.nan, dtype=torch.float64), "not finite"),
        (torch.full((2, 5), torch.inf, dtype=torch.float64), "not finite"),
        (torch.zeros(2, 5, dtype=torch.complex64), "complex64"),
        (torch.zeros(2, 5, dtype=torch.int64), "int64"),
        (torch.zeros(2, 5, dtype=torch.float16), "float16"),
    ],
)
def test_an_array_that_is_none_of_ours_is_refused(array, said, circle, tmp_path):
    LeastSquares().fit(bk.experience(circle)).save(tmp_path)
    description = json.loads((tmp_path / "learned.json").read_text())
    (tmp_path / "learned.json").write_text(json.dumps({**description, "matrix": list(array.shape)}))
    save_file({"matrix": array}, str(tmp_path / "learned.safetensors"))
    with pytest.raises(InvalidConfig, match="holds no learned Jacobian") as caught:
        bk.load_learned(tmp_path)
    assert said in str(caught.value)


def test_arrays_that_do_not_belong_together_are_refused(circle, tmp_path):
    PaperMLP(steps=1).fit(bk.experience(circle)).save(tmp_path)
    arrays = load_file(str(tmp_path / "learned.safetensors"))
    description = json.loads((tmp_path / "learned.json").read_text())
    (tmp_path / "learned.json").write_text(json.dumps({**description, "b1": [9]}))
    save_file({**arrays, "b1": arrays["b1"][:9].contiguous()}, str(tmp_path / "learned.safetensors"))
    with pytest.raises(InvalidConfig, match="b1 has 9 of 'hidden', others have 10"):
        bk.load_learned(tmp_path)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, '{"kind": "x", "pad": "' + "x" * (1 << 22) + '"}'])
def test_descriptions_are_bounded_in_depth_and_length(text, circle, tmp_path):
    LeastSquares().fit(bk.experience(circle)).save(tmp_path)
    (tmp_path / "learned.json").write_text(text)
    with pytest.raises(InvalidConfig, match=r"too deep|longer than"):
        bk.load_learned(tmp_path)


def test_an_ensemble_within_itself_without_end_is_refused(circle, tmp_path):
    LeastSquares().fit(bk.experience(circle)).save(tmp_path)
    description = json.loads((tmp_path / "learned.json").read_text())
    inner = {key: value for key, value in description.items() if key not in ("format", "version")}
    for _ in range(400):
        inner = {"kind": "ensemble", "unit": "", "members": [inner]}
    (tmp_path / "learned.json").write_text(json.dumps({**description, **inner}))
    with pytest.raises(InvalidConfig, match="holds no learned Jacobian"):
        bk.load_learned(tmp_path)


def test_what_is_not_finite_is_not_saved(tmp_path):
    with pytest.raises(InvalidConfig, match="ConstantJacobian cannot be saved: matrix has values that are not finite"):
        bk.estimators.ConstantJacobian(torch.full((2, 3), torch.nan, dtype=torch.float64)).save(tmp_path)


@pytest.mark.parametrize("kind", ["os.system", "bodyimage_kin.estimators:LeastSquares", "LeastSquares", "", "constnat"])
def test_no_class_that_a_file_names_is_imported(circle, tmp_path, kind, monkeypatch):
    LeastSquares().fit(bk.experience(circle)).save(tmp_path)
    description = json.loads((tmp_path / "learned.json").read_text())
    (tmp_path / "learned.json").write_text(json.dumps({**description, "kind": kind}))
    monkeypatch.setattr("importlib.import_module", lambda name: pytest.fail(f"imported {name}"))
    with pytest.raises(UnknownName, match="no kind of learned Jacobian") as caught:
        bk.estimators.load_learned(tmp_path)
    assert "constant" in caught.value.valid


def test_an_interrupted_save_leaves_the_old_one(circle, tmp_path, monkeypatch):
    LeastSquares().fit(bk.experience(circle)).save(tmp_path)
    before = load_file(str(tmp_path / "learned.safetensors"))
    monkeypatch.setattr("bodyimage_kin.estimators._kept.save_file", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        LeastSquares().fit(bk.experience(circle).isel(time=slice(0, 50))).save(tmp_path)
    assert torch.equal(load_file(str(tmp_path / "learned.safetensors"))["matrix"], before["matrix"])
    assert len(list(tmp_path.iterdir())) == 2
