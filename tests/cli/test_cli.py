"""The command line: thin, quick to answer, one line for a user's error."""

from __future__ import annotations

import subprocess
import sys

import pytest

import bodyimage_kin as bk
from bodyimage_kin import cli


def test_help_names_every_command_and_imports_nothing_heavy():
    code = (
        "import sys\nfrom bodyimage_kin import cli\n"
        "try:\n    cli.main(['--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "assert not {'torch', 'numpy', 'pinocchio', 'matplotlib'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for command in ("reproduce", "study", "report", "fit", "conform", "embodiment"):
        assert command in done.stdout


# The run-time checks of types in these tests draw on ``random``, inside Hypothesis's strategies as well.
@pytest.mark.filterwarnings("ignore:Do not use the `random` module")
def test_conform_passes_a_sound_library(tmp_path, capsys):
    assert cli.main(["conform", "--backend", "pinocchio", "--examples", "2", "--out", str(tmp_path / "sound")]) == 0
    assert (tmp_path / "sound" / "report.html").is_file()
    assert "pinocchio" in capsys.readouterr().out


def test_fit_learns_and_saves(tmp_path):
    recording = bk.simulate(bk.load_embodiment("infant"), bk.motions.Circle(turns=0.5), dynamics=False)
    bk.write_recording(recording, tmp_path / "circle.nc")
    arguments = ["fit", "LeastSquares", str(tmp_path / "circle.nc"), "--out", str(tmp_path / "learned")]
    assert cli.main(arguments) == 0
    learned = bk.load_learned(tmp_path / "learned")
    again = bk.estimators.LeastSquares().fit(bk.experience(recording))
    assert bool((learned.jacobian([0.0] * 5) == again.jacobian([0.0] * 5)).all())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["study"], "give a study file"),
        (["study", "missing.toml", "--out", "nowhere"], "missing.toml"),
        (["report", "nowhere"], "nowhere"),
        (["fit", "LeastSquares", "missing.nc", "--out", "nowhere"], "missing.nc"),
        (["fit", "LeastSqares", "missing.nc", "--out", "nowhere"], "did you mean 'LeastSquares'"),
        (["conform", "--backend", "pinochio"], "pinochio"),
        (["conform", "missing.urdf"], "missing.urdf"),
    ],
)
def test_a_wrong_argument_is_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("bodyimage-kin: ")
    assert message in error
    assert list(tmp_path.iterdir()) == []
