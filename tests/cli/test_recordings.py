"""Recordings from the command line: simulated as the library does, and other people's tables turned into ours."""

from __future__ import annotations

import json

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin import cli

TABLE = """stamp,elbow,wrist,u,v,camera
0.0,10,5,300,200,1
0.1,11,6,301,202,1
0.2,12,8,304,203,1
0.3,13,9,,,1
0.4,14,11,-1,-1,1
0.5,99,99,9,9,2
"""
COLUMNS = ["--columns", "q=elbow,wrist", "hand_image=u,v", "time=stamp"]
REST = ["--units", "q=deg", "--where", "camera=1", "--unseen", "-1", "--size", "640", "480"]


@pytest.fixture
def table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "table.csv"
    path.write_text(TABLE)
    return path


def expected(table):
    columns = {"q": ["elbow", "wrist"], "hand_image": ["u", "v"], "time": "stamp"}
    return bk.read_recording(table, columns, units={"q": "deg"}, where={"camera": 1}, unseen=[-1], size=(640, 480))


def test_simulate_writes_what_the_library_records(tmp_path, monkeypatch, capsys, body):
    monkeypatch.chdir(tmp_path)
    arguments = ["simulate", "Circle", "--set", "turns=.25", "radius=0.04", "--kinematic", "--encoder", "1e-3"]
    assert cli.main([*arguments, "--seed", "3", "--trials", "2", "--out", "circle.nc", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    wanted = bk.simulate(
        body, bk.motions.Circle(turns=0.25, radius=0.04), 3, 2, dynamics=False, noise=bk.Noise(encoder=1e-3)
    )
    assert bk.read_recording("circle.nc").identical(wanted)
    assert told["recording"] == "circle.nc"
    assert told["trials"] == 2
    assert told["joints"] == list(body.joints)
    assert told["observations"]["hand_image"] == {"samples": told["samples"], "unit": "m"}


def test_simulate_drags_a_passive_arm_unless_told_otherwise(tmp_path, body):
    out = tmp_path / "touch.nc"
    assert cli.main(["simulate", "RandomTouch", "--set", "duration=1.0", "reset_interval=none", "--out", str(out)]) == 0
    wanted = bk.simulate(body, bk.motions.RandomTouch(duration=1.0, reset_interval=None))
    assert bk.read_recording(out).identical(wanted)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["Cirkle"], "did you mean 'Circle'"),
        (["Circle", "--set", "turn=2"], "did you mean 'turns'"),
        (["Circle", "--set", "turns"], "--set 'turns': give NAME=VALUE"),
        (["Circle", "--set", "turns=1.0", "turns=2.0"], "'turns' is given twice"),
        (["Circle", "--set", "turns=-1.0"], "turns=-1.0"),
        (["Circle", "--embodiment", "infnat"], "did you mean 'infant'"),
    ],
)
def test_what_simulate_cannot_do_is_told_before_anything_is_written(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["simulate", *arguments, "--out", "circle.nc"]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_import_reads_a_table_as_the_library_does(table, capsys):
    assert cli.main(["import", str(table), *COLUMNS, *REST, "--out", "lab.nc"]) == 0
    assert bk.read_recording("lab.nc").identical(expected(table))
    told = capsys.readouterr().out.splitlines()
    assert told == [
        "lab.nc: stream, trials 1, samples 5",
        "joints [rad]: elbow, wrist",
        "hand_image [px]: in 3 of 5 samples",
    ]


@pytest.mark.parametrize(
    "columns",
    [
        ["q=1,2", "hand_image=3,4", "time=0"],
        ["q=elbow:1,wrist:2", "hand_image=3,4", "time=0"],
        ["q=elbow:elbow,wrist:wrist", "hand_image=u,v", "time=stamp"],
    ],
)
def test_import_takes_columns_by_position_and_by_joint(table, columns):
    where = ["camera=1"] if "stamp" in columns[-1] else ["5=1"]
    names = [] if ":" in columns[0] else ["--joints", "elbow", "wrist"]
    arguments = ["--columns", *columns, *names, "--units", "q=deg", "--where", *where, "--unseen", "-1"]
    assert cli.main(["import", str(table), *arguments, "--out", "lab.nc"]) == 0
    found = bk.read_recording("lab.nc")
    np.testing.assert_array_equal(found["q"], expected(table)["q"])
    np.testing.assert_array_equal(found["hand_image"], expected(table)["hand_image"])
    assert found["joint"].values.tolist() == ["elbow", "wrist"]


def test_import_reads_its_settings_from_a_file_and_is_told_better(table):
    (table.parent / "lab.toml").write_text(
        'where = {camera = 1}\nunseen = [-1]\nsize = [640, 480]\nunits = {q = "rad"}\n'
        '[columns]\ntime = "stamp"\nhand_image = ["u", "v"]\nq = {elbow = "elbow", wrist = "wrist"}\n'
    )
    arguments = ["import", str(table), "--settings", "lab.toml", "--units", "q=deg", "--out", "lab.nc"]
    assert cli.main(arguments) == 0
    assert bk.read_recording("lab.nc").identical(expected(table))


def test_import_puts_samples_on_a_clock(table):
    arguments = ["import", str(table), *COLUMNS, *REST, "--sampling", "0.05", "--out", "lab.nc"]
    assert cli.main(arguments) == 0
    found = bk.read_recording("lab.nc")
    assert found.attrs["sampling"] == 0.05
    assert found.sizes["time"] == 9


def test_import_reads_bags(tmp_path, monkeypatch, capsys):
    pytest.importorskip("rosbags", reason="bags need the extra [bags]")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.mcap").write_bytes(b"no bag")
    topics = ["--columns", "q=/joint_states", "hand_position=/tf[marker_7]", "--join-within", "0.2"]
    assert cli.main(["import", "run.mcap", *topics, "--out", "lab.nc"]) == 2
    assert "'run.mcap' is no bag that can be read" in capsys.readouterr().err


def test_import_checks_joints_and_unit_by_a_robot_or_a_body(tmp_path, monkeypatch, capsys, body):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    q = body.felt_robot.sample(20, seed=0).numpy()
    rows = np.hstack([q, rng.normal(size=(20, 2))])
    np.savetxt("table.csv", rows, delimiter=",", header=",".join([*body.joints, "x", "y"]), comments="")
    arguments = ["import", "table.csv", "--order", "scattered", "--out", "lab.nc", "--robot"]
    columns = ["--columns", f"q={','.join(body.joints)}", "hand_image=x,y"]
    assert cli.main([*arguments, "infant", *columns]) == 0
    assert bk.read_recording("lab.nc")["hand_image"].attrs["units"] == "m"
    body.save("mine.toml")
    assert cli.main([*arguments, "mine.toml", *columns, "--overwrite"]) == 0
    assert cli.main([*arguments, str(body.robot.file), *columns, "--overwrite"]) == 0
    assert bk.read_recording("lab.nc")["hand_image"].attrs["units"] == "px"
    wrong = ["--columns", f"q={','.join(('elbw', *body.joints[1:]))}", "hand_image=x,y", "--overwrite"]
    assert cli.main([*arguments, "infant", *wrong]) == 2
    assert "elbw" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*COLUMNS, "--size", "200", "200"], "line 2, column 'u': 300 is outside the image of 200 x 200"),
        (["--columns", "q=elbow,", "hand_image=u,v"], "give names with commas between them"),
        (["--columns", "q=elbow,wrst", "hand_image=u,v", "time=stamp"], "did you mean 'wrist'"),
        (["--columns", "qq=elbow"], "no variable of a recording 'qq'"),
        (["--settings", "missing.toml"], "cannot read 'missing.toml'"),
        (["--settings", "table.csv"], "is no valid TOML"),
    ],
)
def test_what_import_cannot_read_is_one_line_and_nothing_is_written(table, capsys, arguments, message):
    assert cli.main(["import", str(table), *arguments, "--out", "lab.nc"]) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("bodyimage-kin: ")
    assert message in error
    assert "\n" not in error
    assert [path.name for path in table.parent.iterdir()] == ["table.csv"]


def test_nothing_is_overwritten_unless_it_is_said(table, capsys):
    (table.parent / "lab.nc").write_text("precious")
    arguments = ["import", str(table), *COLUMNS, *REST, "--out", "lab.nc"]
    assert cli.main(arguments) == 2
    assert "'lab.nc' is there already" in capsys.readouterr().err
    assert (table.parent / "lab.nc").read_text() == "precious"
    assert cli.main([*arguments, "--overwrite"]) == 0
    assert bk.read_recording("lab.nc").identical(expected(table))
    assert cli.main([*arguments[:-1], "nowhere/lab.nc"]) == 2
    assert "there is no folder 'nowhere'" in capsys.readouterr().err


def test_what_a_table_lacks_is_noted_without_a_place_in_the_code(table, capsys):
    table.write_text(TABLE.replace(",9,9,2", ",9,9,1").replace("99,99", "15,11").replace("0.5", "60"))
    assert cli.main(["import", str(table), *COLUMNS, "--units", "q=deg", "--out", "lab.nc"]) == 0
    error = capsys.readouterr().err
    assert error.startswith("bodyimage-kin: note: 'table.csv', line 7, column 'stamp': a gap before it")
    assert "columns.py" not in error
