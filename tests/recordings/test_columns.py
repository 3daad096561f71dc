"""From other people's tables to recordings: names and units once, and what people get wrong said with its place."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.io

import bodyimage_kin as bk
from bodyimage_kin.errors import DataWarning, InvalidConfig, InvalidRecording, UnknownName

ARM = """<robot name="arm"><link name="base"/><link name="upper"/><link name="hand"/>
<joint name="elbow" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="wrist" type="revolute"><parent link="upper"/><child link="hand"/><origin xyz="1 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture(scope="module")
def arm():
    return bk.Robot.from_urdf(ARM)


def table(count=20, **changes):
    """Columns of a smooth motion, some of them changed."""
    t = 0.1 * np.arange(count)
    columns = {
        "stamp": t,
        "elbow": 0.5 * np.sin(t),
        "wrist": 0.3 * np.cos(t),
        "u": 300 + 50 * np.sin(t),
        "v": 200 + 20 * np.cos(t),
    }
    return {**columns, **changes}


def written(folder, columns, name="table.csv"):
    path = folder / name
    rows = [",".join(columns)]
    for values in zip(*columns.values(), strict=True):
        rows.append(",".join("" if isinstance(v, float) and math.isnan(v) else str(v) for v in values))
    path.write_text("\n".join(rows) + "\n")
    return path


COLUMNS = {"q": ["elbow", "wrist"], "hand_image": ["u", "v"], "time": "stamp"}


def test_a_table_becomes_a_recording(tmp_path, arm):
    columns = table()
    columns["u"][3] = math.nan
    rec = bk.read_recording(written(tmp_path, columns), COLUMNS, robot=arm)
    assert list(rec["joint"].values) == ["elbow", "wrist"]
    np.testing.assert_array_equal(rec["q"].values[0, :, 0], columns["elbow"])
    assert np.isnan(rec["hand_image"].values[0, 3]).all()
    np.testing.assert_array_equal(rec["hand_image"].values[0, 4], [columns["u"][4], columns["v"][4]])
    assert rec["hand_image"].attrs["units"] == "px"
    assert rec.attrs["order"] == "stream"
    np.testing.assert_allclose(rec["time"], columns["stamp"])
    # What was read is a recording like any other.
    bk.write_recording(rec, tmp_path / "again.nc")
    np.testing.assert_array_equal(bk.read_recording(tmp_path / "again.nc")["q"], rec["q"])


def test_joints_by_name_by_pattern_by_position_and_by_the_robot(tmp_path, arm):
    path = written(tmp_path, table())
    wanted = bk.read_recording(path, COLUMNS)["q"].values
    ours = {"u": "hand_image.u", "v": "hand_image.v", "stamp": "time"}
    others = [
        bk.read_recording(path, COLUMNS | {"q": {"elbow": "elbow", "wrist": "wrist"}}),
        bk.read_recording(path, {"q": [1, 2], "hand_image": [3, 4], "time": 0}, joints=["elbow", "wrist"]),
        bk.read_recording(
            written(tmp_path, {f"q.{k}" if k in ("elbow", "wrist") else k: v for k, v in table().items()}, "b.csv"),
            COLUMNS | {"q": "q.*"},
        ),
        bk.read_recording(written(tmp_path, {ours.get(k, k): v for k, v in table().items()}, "c.csv"), robot=arm),
    ]
    for one in others:
        np.testing.assert_array_equal(one["q"].values, wanted)
        assert list(one["joint"].values) == ["elbow", "wrist"]


def test_units_are_converted_and_said(tmp_path, arm):
    columns = table()
    degrees = {**columns, "elbow": np.degrees(columns["elbow"]), "wrist": np.degrees(columns["wrist"])}
    degrees |= {"stamp": 1000 * columns["stamp"], "x": columns["u"], "y": columns["v"], "z": columns["v"]}
    rec = bk.read_recording(
        written(tmp_path, degrees),
        {"q": ["elbow", "wrist"], "hand_position": ["x", "y", "z"], "time": "stamp"},
        units={"q": "deg", "hand_position": "mm", "time": "ms"},
        robot=arm,
    )
    np.testing.assert_allclose(rec["q"].values[0, :, 0], columns["elbow"], atol=1e-15)
    np.testing.assert_allclose(rec["hand_position"].values[0, :, 0], columns["u"] / 1000, rtol=1e-14)
    np.testing.assert_allclose(rec["time"], columns["stamp"], atol=1e-12)


SLIDER = ARM.replace('name="wrist" type="revolute"', 'name="wrist" type="prismatic"')


def test_joints_that_slide_have_a_unit_of_their_own(tmp_path):
    slider, columns = bk.Robot.from_urdf(SLIDER), table()
    mixed = {**columns, "elbow": np.degrees(columns["elbow"]), "wrist": 1000 * columns["wrist"]}
    path = written(tmp_path, mixed)
    for robot in (slider, None):
        rec = bk.read_recording(path, COLUMNS, units={"q": {"elbow": "deg", "wrist": "mm"}}, robot=robot)
        assert rec["q"].attrs["units"] == "rad m"
        np.testing.assert_allclose(rec["q"].values[0], np.stack([columns["elbow"], columns["wrist"]], 1), atol=1e-15)
    # Degrees are said of what turns.
    angles = written(tmp_path, {**columns, "elbow": np.degrees(columns["elbow"])}, "angles.csv")
    rec = bk.read_recording(angles, COLUMNS, units={"q": "deg"}, robot=slider)
    np.testing.assert_array_equal(rec["q"].values[0, :, 1], columns["wrist"])
    assert rec["q"].attrs["units"] == "rad m"
    with pytest.raises(InvalidConfig, match="'mm' of joint 'elbow', which turns; its unit is 'rad' or 'deg'"):
        bk.read_recording(path, COLUMNS, units={"q": "mm"}, robot=slider)
    with pytest.raises(InvalidRecording, match=r"joint 'wrist' is \d+\.?\d*, beyond .*in millimetres give units"):
        bk.read_recording(path, COLUMNS, units={"q": {"elbow": "deg"}}, robot=slider)
    with pytest.raises(UnknownName, match="did you mean 'wrist'"):
        bk.read_recording(path, COLUMNS, units={"q": {"wirst": "mm"}})


def test_numbers_that_must_be_whole_say_where_they_are_not(tmp_path):
    path = written(tmp_path, table(part=np.r_[np.zeros(10), 1.5, np.ones(9)]))
    with pytest.raises(
        InvalidRecording, match=r"line 12, column 'part': 1.5 is no whole number; block has one in each"
    ):
        bk.read_recording(path, COLUMNS | {"block": "part"})


def test_trials_by_a_column_and_by_gaps(tmp_path):
    stamp = np.concatenate([0.1 * np.arange(8), 5 + 0.1 * np.arange(12)])
    rec = bk.read_recording(written(tmp_path, table(stamp=stamp)), COLUMNS, gap=1.0)
    assert rec.sizes["trial"] == 2
    assert np.isfinite(rec["q"].values[..., 0]).sum(1).tolist() == [8, 12]
    run = np.array(["1"] * 8 + ["2"] * 12)
    again = bk.read_recording(written(tmp_path, table(stamp=stamp, run=run)), COLUMNS | {"trial": "run"})
    np.testing.assert_array_equal(again["q"], rec["q"])
    with pytest.warns(DataWarning, match=r"line 10, column 'stamp': a gap before it \(1 such\); give gap="):
        bk.read_recording(written(tmp_path, table(stamp=stamp)), COLUMNS)


def test_only_the_rows_that_are_meant(tmp_path):
    camera = np.arange(20) % 2 + 1
    rec = bk.read_recording(written(tmp_path, table(camera=camera)), COLUMNS, where={"camera": 2})
    np.testing.assert_array_equal(rec["q"].values[0, :, 0], table()["elbow"][1::2])
    with pytest.raises(InvalidRecording, match="no row is left"):
        bk.read_recording(written(tmp_path, table(camera=camera)), COLUMNS, where={"camera": 3})


def test_numbers_that_stand_for_unseen(tmp_path):
    columns = table()
    columns["u"][2] = columns["v"][2] = -1
    columns["u"][5] = -1
    rec = bk.read_recording(written(tmp_path, columns), COLUMNS, unseen=[-1])
    assert np.isnan(rec["hand_image"].values[0, 2]).all()
    assert rec["hand_image"].values[0, 5, 0] == -1
    # Many trackers say 0, 0.
    columns["u"][7] = columns["v"][7] = 0
    rec = bk.read_recording(written(tmp_path, columns), COLUMNS, unseen=[-1, 0])
    assert np.isnan(rec["hand_image"].values[0, [2, 7]]).all()
    assert np.isfinite(rec["hand_image"].values[0, 5]).all()
    with pytest.raises(InvalidRecording, match=r"line 7, column 'u': -1 is outside the image of 640 x 480"):
        bk.read_recording(written(tmp_path, columns), COLUMNS, unseen=[-1, 0], size=(640, 480))


WRONG = {
    "degrees, by the limits": (
        {"elbow": 30 + 10 * np.sin(np.arange(20))}, {"robot": True},
        r"line \d+, column 'elbow': joint 'elbow' is [\d.]+, beyond its limits -2 to 2; if it is in degrees",
    ),
    "degrees, without a robot": ({"elbow": 90 * np.sin(0.1 * np.arange(20))}, {}, r"two turns and more; .*'deg'"),
    "time goes backwards": ({"stamp": np.r_[0.1 * np.arange(10), 0.1 * np.arange(10)]}, {}, r"line 12.*goes backwards"),
    "time stands still": ({"stamp": np.r_[0.1 * np.arange(19), 1.8]}, {}, "line 21.*stands still"),
    "no joint moves": ({"elbow": np.zeros(20), "wrist": np.ones(20)}, {}, "no joint moves"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_people_get_wrong_is_said_with_its_place(tmp_path, arm, case):
    changes, options, message = WRONG[case]
    with pytest.raises(InvalidRecording, match=message):
        bk.read_recording(
            written(tmp_path, table(**changes)), COLUMNS, **({"robot": arm} if options.get("robot") else {})
        )


def test_what_is_said_to_be_radians_is_believed(tmp_path):
    turns = table(elbow=np.linspace(0, 30, 20))
    rec = bk.read_recording(written(tmp_path, turns), COLUMNS, units={"q": "rad"})
    np.testing.assert_array_equal(rec["q"].values[0, :, 0], turns["elbow"])


def test_millimetres_for_metres(tmp_path):
    columns = table(x=np.full(20, 800.0), y=np.zeros(20), z=np.zeros(20))
    with pytest.raises(InvalidRecording, match=r"line 2, column 'x': 800 m is too far.*'mm'"):
        bk.read_recording(
            written(tmp_path, columns), {"q": ["elbow", "wrist"], "hand_position": ["x", "y", "z"], "time": "stamp"}
        )


def test_doubled_rows_and_still_joints_are_told(tmp_path):
    columns = {name: np.r_[values, values[4]] for name, values in table().items() if name != "stamp"}
    scattered = {name: one for name, one in COLUMNS.items() if name != "time"}
    with pytest.warns(DataWarning, match=r"line 6, column 'elbow': this row stands 2 times"):
        bk.read_recording(written(tmp_path, columns), scattered, order="scattered")
    with pytest.warns(DataWarning, match="joint 'wrist' never moves"):
        bk.read_recording(written(tmp_path, table(wrist=np.ones(20))), COLUMNS)


@pytest.mark.parametrize(
    ("columns", "options", "error", "message"),
    [
        ({"q": ["elbov", "wrist"]}, {}, UnknownName, "did you mean 'elbow'"),
        ({"q": "arm.*"}, {}, UnknownName, r"like 'arm\.\*'"),
        ({"q": {"elbow": "elbow", "shoulder": "wrist"}}, {"robot": True}, UnknownName, "no joint 'shoulder'"),
        ({"q": ["elbow", "wrist"]}, {"joints": ["elbow", "elbow"]}, InvalidConfig, "'elbow' is named twice"),
        ({"q": ["elbow", "wrist"]}, {"joints": ["elbow"]}, InvalidConfig, "1 names for 2 columns"),
        ({"qq": ["elbow"]}, {}, UnknownName, "no variable of a recording 'qq'"),
        ({"hand_image": ["u", "v"]}, {}, InvalidConfig, "'q' is missing"),
        ({"q": ["elbow", "wrist"]}, {"units": {"q": "grad"}}, InvalidConfig, "units"),
        ({"q": ["elbow", "wrist"]}, {"units": {"time": "s"}}, InvalidConfig, "gets no time"),
        ({"q": ["elbow", "wrist"], "hand_image": ["u", "v"]}, {}, InvalidRecording, "order='scattered'"),
        ({"q": ["elbow", "wrist"], "hand_position": ["u", "v"]}, {}, InvalidConfig, "give 3"),
    ],
)
def test_columns_that_do_not_fit_are_named(tmp_path, arm, columns, options, error, message):
    if options.pop("robot", False):
        options["robot"] = arm
    with pytest.raises(error, match=message):
        bk.read_recording(written(tmp_path, table()), columns, **options)


def test_options_of_tables_are_refused_for_our_own_files(tmp_path):
    bk.write_recording(bk.read_recording(written(tmp_path, table()), COLUMNS), tmp_path / "ours.nc")
    with pytest.raises(InvalidConfig, match="units: this is of tables"):
        bk.read_recording(tmp_path / "ours.nc", units={"q": "deg"})


def test_touches_of_several_taxels_at_once(tmp_path):
    records = np.array(
        [({"elbow": 0.1, "wrist": 0.2}, [4, 7]), ({"elbow": 0.3, "wrist": 0.1}, 5), ({"elbow": 0.2, "wrist": 0.4}, [])],
        dtype=[("angles", object), ("taxels", object)],
    )
    scipy.io.savemat(tmp_path / "touch.mat", {"touches": records})
    rec = bk.read_recording(tmp_path / "touch.mat", {"q": "angles.*", "touched": "taxels"}, order="scattered")
    assert rec.attrs["order"] == "scattered"
    rows = {
        tuple(np.round(q, 3)): sorted(t[t >= 0].tolist())
        for q, t in zip(rec["q"].values[0], rec["touched"].values[0], strict=True)
    }
    assert rows == {(0.1, 0.2): [4, 7], (0.3, 0.1): [5], (0.2, 0.4): []}


@pytest.mark.real_data
@pytest.mark.filterwarnings("ignore::bodyimage_kin.errors.DataWarning")  # rows of several markers a posture
def test_the_real_files_are_read_as_their_authors_publish_them(real_data):
    nao = bk.Robot.from_urdf(real_data / "nao" / "nao.urdf")
    arm = ("RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll", "RWristYaw")
    touches = {"q": {name: f"angles.{name}" for name in arm}, "touched": "activatedTaxels"}
    rec = bk.read_recording(real_data / "nao" / "torso_rightFinger.mat", touches, robot=nao, order="scattered")
    assert rec.sizes["time"] == 1075
    assert (rec["touched"].values >= 0).any(-1).all()
    cube = real_data / "motoman" / "leica_right_hand_6x6x6_dataset.mat"
    cube_rows = {"q": [6, *range(7, 13)], "hand_position": [19, 20, 21]}
    assert bk.read_recording(cube, cube_rows, where={3: 1}, order="scattered").sizes["time"] > 212
    with pytest.raises(InvalidRecording, match="header has 10 names, line 2 has 261 values"):
        bk.read_recording(real_data / "tactile_arm" / "no_tool.csv", {"q": "jointAngle*"})
    pad = bk.read_recording(
        real_data / "tactile_arm" / "exp_simple2d_all.csv",
        {"q": ["jointAngle1", "jointAngle2"], "touched": ["touch_row"]},
        order="scattered",
    )
    assert pad.sizes["time"] == 15834
