"""Study files that are wrong in every way: one typed line, at once, and nothing that they name runs."""

from __future__ import annotations

import time

import my_scores
import pytest
import tomli_w

from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, UnknownName
from bodyimage_kin.study import Study, read_study

SOUND = {"embodiments": {"infant": "infant"}, "recordings": {"near": "Circle"}, "estimators": {"flat": "LeastSquares"}}
DEEP: dict = {}
inner = DEEP
for _ in range(300):
    inner["a"] = {}
    inner = inner["a"]

pytestmark = pytest.mark.usefixtures("unchecked")
WRONG = {
    "fields": [
        *(
            {"seeds": bad}
            for bad in (
                1.5,
                float("nan"),
                float("inf"),
                1e14,
                10**14,
                -1,
                True,
                "3",
                [],
                [1.5],
                [-1],
                [True],
                {"a": 1},
                [[1]],
            )
        ),
        *({"block": bad} for bad in (0, 1.0, True, "2", [2])),
        *({"seed": bad} for bad in (-1, 1.5, True, "0")),
        *(
            {"scores": bad}
            for bad in (3, [], "relative_error", [3], {"a": 1}, ["nothing"], ["os:system"], ["a" * 10**5], [True])
        ),
        *({"facts": bad} for bad in (3, "excitation", [3], ["nothing"])),
        *({"excitation_cut": bad} for bad in (-0.1, float("nan"), float("inf"), "a", True, [0.1])),
        *({"time_limit": bad} for bad in (0, -1.0, float("nan"), float("inf"), "a", True)),
        *({"per_posture": bad} for bad in (1, "true", [True])),
        *({"first_maps": bad} for bad in (0, 1.0, "2", True, {"a": 0}, {"0": 1.5}, [1])),
        *({"maps": bad} for bad in (3, {"gama": 1.0}, {"seed": 1}, [1])),
        *({"metric_of": bad} for bad in (3, "guessed")),
        *({"labels": bad} for bad in (3, ["a"], {"a": 1}, {"a": ""}, {"": "a"})),
        {"nonsense": 1},
        {"metrics": ["relative_error"]},
        {"a" * 10**5: 1},
        {"folder": "/"},
    ],
    "embodiments": [
        3,
        "",
        [],
        {},
        {"../up": "infant"},
        {"a" * 101: "infant"},
        {"i": 3},
        {"i": []},
        {"i": {"embodiment": 3}},
        {"i": {"backend": "torch"}},
        {"i": {"embodiment": "infant", "back": "torch"}},
    ],
    "recordings": [
        3,
        {},
        [],
        "Circle",
        {"a/b": "Circle"},
        {"a": 3},
        {"a": "circle"},
        {"a": "Nothing"},
        {"a": []},
        {"a": {}},
        {"a": {"Circle": 3}},
        *(
            {"a": {"Circle": {field: bad}}}
            for field in ("radius", "turns", "speed", "sampling", "rest_spread", "distance")
            for bad in (-1, "5cm", True, float("nan"), float("inf"), [1.0], {"a": 1})
        ),
        {"a": {"Circle": {"turns": 0}}},
        {"a": {"Circle": {"sampling": 0}}},
        {"a": {"Circle": {"radios": 1.0}}},
        {"a": {"Circle": {}, "RandomTouch": {}}},
        {"a": {"training": "Circle", "trials": 0}},
        {"a": {"training": "Circle", "dynamics": "yes"}},
        {"a": {"training": "Circle", "dynamics": {"stiffness": -1}}},
        {"a": {"training": "Circle", "dynamics": {"stiff": 1}}},
        {"a": {"training": "Circle", "noise": 3}},
        {"a": {"training": "Circle", "noise": {"encoder": -1}}},
        {"a": {"training": "Circle", "noise": {"encoder_noise": 1.0}}},
        {"a": {"training": "Circle", "stream": 3}},
        {"a": {"training": "Circle", "use": ["RandomTouch", "RandomTouch"]}},
        {"a": {"training": "missing.nc"}},
        {"a": {"recording": "missing.nc"}},
        {"a": {"recording": 3}},
        {"a": {"training": "subprocess:Popen"}},
        {"a": "os:system"},
        {"a": "my_scores:NoMotion"},
        {"a": DEEP},
    ],
    "estimators": [
        3,
        {},
        "LeastSquares",
        {"a b": "LeastSquares"},
        {"a": 3},
        {"a": ""},
        {"a": "leastsquares"},
        {"a": {"LeastSquares": 3}},
        {"a": {"LeastSquares": {"scal": 1.0}}},
        {"a": {"LeastSquares": {"scale": "a"}}},
        *({"a": {"PaperMLP": {"steps": bad}}} for bad in (-1, 1.5, "a", True, [1], {"a": 1})),
        {"a": {"PaperMLP": {}, "Ridge": {}}},
        {"a": {"Ensemble": {}}},
        {"a": {"Ensemble": {"spec": 3}}},
        {"a": {"Ensemble": {"spec": {"subprocess:Popen": {"args": "x"}}}}},
        {"a": {"no_such_module:A": {}}},
        {"a": ":"},
        {"a": "a:"},
        {"a": "os:path"},
        {"a": "math:pi"},
        {"a": "\0:A"},
        {"a": "x" * 10**5 + ":A"},
        {"a": {"estimator": "Ridge", "nothing": 1}},
        {"a": {"estimator": "Ridge", "method": "rk4"}},
        {"a": {"estimator": "Ridge", "reset": 3}},
        {"a": {"estimator": "Ridge", "substeps": 0}},
        {"a": {"estimator": "Ridge", "on": "near"}},
        {"a": {"estimator": "Ridge", "on": ["far"]}},
        {"a": {"estimator": "Ridge", "told": {"penalty": 3}}},
        {"a": {"estimator": "Ridge", "told": 3}},
        {"a": {"estimator": "Ridge", "first_maps": 0}},
        {"a": DEEP},
    ],
    "probes": [
        3,
        {},
        {"a": 3},
        {"a": "nowhere"},
        {"a": {"Face": {"distance": -1}}},
        {"a": {"Face": {"distance": "a"}}},
        {"a": {"JointSpace": {"count": 0}}},
        {"a": {"JointSpace": {"count": 1.5}}},
        {"a": {"Face": {"far": 1}}},
        {"a": "subprocess:Popen"},
    ],
}


def tables():
    for name, bad in WRONG.items():
        for index, one in enumerate(bad):
            table = {**SOUND, **one} if name == "fields" else {**SOUND, name: one}
            yield pytest.param(table, id=f"{name}{index}")


@pytest.mark.parametrize("table", list(tables()))
def test_a_wrong_table_is_one_typed_line_at_once(table):
    begin = time.monotonic()
    with pytest.raises((InvalidConfig, UnknownName)) as caught:
        Study.from_table(table)
    assert time.monotonic() - begin < 2.0
    said = str(caught.value)
    assert "\n" not in said
    assert len(said) < 1500


def test_what_a_wrong_table_says_of_a_lone_wrong_value_names_it():
    for table in (*WRONG["fields"][:8], {"block": 0}, {"time_limit": -1.0}):
        with pytest.raises(BodyImageKinError, match=next(iter(table))):
            Study.from_table({**SOUND, **table})


@pytest.mark.parametrize("kind", ["estimators", "recordings", "probes", "scores"])
def test_nothing_is_run_before_it_is_known_to_be_what_is_wanted(kind, tmp_path):
    ran = tmp_path / "ran"
    popen = {"subprocess:Popen": {"args": f"touch {ran}", "shell": True}}
    with pytest.raises(InvalidConfig):
        Study.from_table({**SOUND, kind: ["subprocess:Popen"] if kind == "scores" else {"a": popen}})
    with pytest.raises(InvalidConfig):
        Study.from_table({**SOUND, "estimators": {"a": {"Ensemble": {"spec": popen}}}})
    with pytest.raises(InvalidConfig, match=r"a subclass of bk\.motions\.Motion"):
        Study.from_table({**SOUND, "recordings": {"a": "my_scores:NoMotion"}})
    time.sleep(0.2)
    assert not ran.exists()
    assert my_scores.NoMotion.built == 0


@pytest.mark.parametrize(
    "key", ["a." * 50_000 + "a", '"a".' * 50_000 + "b", "a . " * 50_000 + "a", '"a b".' * 50_000 + "a"]
)
def test_a_key_of_very_many_parts_is_refused_at_once(key, tmp_path):
    path = tmp_path / "study.toml"
    begin = time.monotonic()
    for text in (f"{key} = 1\n", f"[{key}]\nb = 1\n", f"x = {{{key} = 1}}\n"):
        path.write_text(text)
        with pytest.raises(InvalidConfig, match="more than 40 parts"):
            Study.from_toml(path)
    assert time.monotonic() - begin < 3.0


def test_a_file_that_is_too_large_or_too_deep_is_refused(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text("# " + "a" * (5 * 2**20))
    with pytest.raises(InvalidConfig, match="bytes"):
        Study.from_toml(path)
    path.write_text("a = " + "[" * 5000 + "]" * 5000)
    with pytest.raises(InvalidConfig):
        Study.from_toml(path)
    path.write_text(tomli_w.dumps(SOUND))
    assert Study.from_toml(path) == Study(**SOUND)


@pytest.mark.parametrize(
    "marker",
    [
        "{",
        "[]",
        "null",
        '{"kind": "study"}',
        '{"kind": "study", "settings": 3}',
        '{"kind": "study", "settings": {}}',
        '{"kind": "study", "settings": {"config": 3}}',
        '{"kind": "study", "settings": {"config": {"embodiments": []}}}',
        '{"kind": "study", "settings": {"config": {"embodiments": {"a": {}}, "recordings": {"b": {}}, '
        '"estimators": {"c": {}}, "seeds": [0], "block": 0, "scores": [], '
        '"probes": {}}, "embodiment_sha256": {"a": ""}}}',
        "[" * 10**5,
    ],
)
def test_a_hostile_marker_is_a_typed_error(marker, tmp_path):
    (tmp_path / "bodyimage_kin.json").write_text(marker)
    with pytest.raises(InvalidConfig, match="holds no study"):
        read_study(tmp_path)
