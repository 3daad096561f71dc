"""The command line: thin, quick to answer, one line for a user's error."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import bodyimage_kin as bk
from bodyimage_kin import cli

COMMANDS = (
    *("reproduce", "study", "report", "simulate", "import", "fit", "score", "calibrate", "next"),
    *("embodiment", "view", "conform", "doctor"),
)


def test_help_names_every_command_and_imports_nothing_heavy():
    code = (
        "import sys\nfrom bodyimage_kin import cli\n"
        "try:\n    cli.main(['--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "assert not {'torch', 'numpy', 'pinocchio', 'matplotlib'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for command in COMMANDS:
        assert f"• {command} " in done.stdout
    assert "Exit status: 0 all well; 1 " in done.stdout
    assert "\x1b" not in done.stdout  # colours are for terminals


@pytest.mark.parametrize("line", [*COMMANDS, "embodiment new", "embodiment check"])
def test_each_help_has_examples_that_are_understood_and_no_word_of_python(line, capsys):
    command = line.split()[0]
    with pytest.raises(SystemExit) as end:
        cli.main([*line.split(), "--help"])
    assert end.value.code == 0
    told = capsys.readouterr().out
    assert "{None}" not in told
    assert "default: None" not in told
    assert "{True,False}" not in told
    examples = re.findall(r"^  (bodyimage-kin .*)$", told, re.MULTILINE)
    assert examples
    assert command == line or all(f"bodyimage-kin {line} " in example for example in examples)
    for example in examples:
        # Parsed by the same parser; nothing is run.
        assert isinstance(cli._parsed(shlex.split(example)[1:]), cli._COMMANDS[command])


def test_the_version_is_one_line(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"bodyimage-kin {bk.__version__}\n"


def test_completion_of_a_shell_knows_commands_and_options(capsys):
    with pytest.raises(SystemExit):
        cli.main(["--tyro-print-completion", "bash"])
    told = capsys.readouterr().out
    assert "simulate" in told
    assert "--kinematic" in told


# What fails ----------------------------------------------------------------------------------------------------------


def test_a_traceback_is_shown_on_request_alone(tmp_path, capsys):
    arguments = ["fit", "LeastSquares", str(tmp_path / "missing.nc"), "--out", str(tmp_path / "out")]
    assert cli.main(arguments) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert cli.main([*arguments, "--debug"]) == 2
    told = capsys.readouterr().err
    assert "Traceback" in told
    assert told.splitlines()[-1].startswith("bodyimage-kin: there is no recording")


def test_an_error_of_ours_is_one_line_with_a_status_of_its_own(monkeypatch, capsys):
    def broken(self):
        raise ZeroDivisionError("float\ndivision")

    monkeypatch.setattr(cli._COMMANDS["report"], "__call__", broken)
    assert cli.main(["report", "anywhere"]) == 70
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "an error of ours, ZeroDivisionError: float division; the same command with --debug shows where" in error


def test_whoever_reads_no_further_is_not_told_of_it(tmp_path):
    code = "import sys\nfrom bodyimage_kin import cli\nsys.exit(cli.main(['embodiment', 'check', 'infant', '--json']))"
    command = f"{shlex.quote(sys.executable)} -c {shlex.quote(code)} | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert done.stdout.strip() in ("141", "0")
    assert "Traceback" not in done.stderr
    assert "BrokenPipe" not in done.stderr


# Commands ------------------------------------------------------------------------------------------------------------


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


@pytest.mark.slow
def test_a_body_is_proposed_written_and_drawn(tmp_path, capsys):
    urdf = str(bk.load_embodiment("infant").robot.file)
    asked = ["embodiment", "new", urdf, "--hand", "left_hand", "--camera", "right_eye", "-o", str(tmp_path / "my.toml")]
    assert cli.main(asked) == 0
    said = capsys.readouterr().out
    assert "home: the hand 50 mm in front of the middle taxel" in said
    # Fit, but for one taxel on whose touch the forearm comes near the head.
    (told,) = (line for line in said.splitlines() if line.startswith(("error: ", "note: ")))
    assert told.startswith("note: touch: at 1 of 25 taxels looked at 'head' and 'left_forearm' overlap")
    assert bk.load_embodiment(tmp_path / "my.toml").name == "my"
    assert (tmp_path / "my.png").read_bytes()[1:4] == b"PNG"
    assert cli.main(asked) == 2
    assert "is there already" in capsys.readouterr().err
    foot = [*asked[:4], "left_foot", *asked[5:-1], str(tmp_path / "foot.toml")]
    assert cli.main(foot) == 2
    told = capsys.readouterr()
    assert "gets no nearer than" in told.err
    assert "eye" in told.out


def test_a_robot_from_outside_the_files_folder_is_told(tmp_path, capsys):
    inner = tmp_path / "inner"
    inner.mkdir()
    body = bk.load_embodiment("infant")
    (tmp_path / "infant.urdf").write_bytes(body.robot.source)
    (inner / "infant.urdf").write_bytes(body.robot.source)
    (inner / "out.toml").write_text(body.to_toml("../infant.urdf"))
    (inner / "in.toml").write_text(body.to_toml("infant.urdf"))
    assert cli.main(["embodiment", "check", str(inner / "out.toml")]) == 0
    place = (tmp_path / "infant.urdf").resolve()
    assert f"note: robot: 'urdf' is read from outside the file's folder: {place}" in capsys.readouterr().out
    assert cli.main(["embodiment", "check", str(inner / "in.toml")]) == 0
    assert "outside" not in capsys.readouterr().out


def test_findings_of_a_body_as_json(capsys):
    assert cli.main(["embodiment", "check", "infant", "--paper", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"embodiment": "infant", "fit": True, "findings": []}


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


# The pages -----------------------------------------------------------------------------------------------------------

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "comparisons").rglob("*.md"))]


def commands_of_pages():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for block in re.findall(r"^```(?:sh|console|bash)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
            for line in block.replace("\\\n", " ").splitlines():
                if line.lstrip("$ ").startswith("bodyimage-kin "):
                    yield page.name, line.lstrip("$ ").split(" #")[0]


def test_every_command_that_the_pages_show_is_understood(capsys):
    shown = list(commands_of_pages())
    assert len(shown) > 5
    for page, line in shown:
        arguments = shlex.split(line)[1:]
        if "--help" in arguments or "completion" in line:
            # Printed, instead of written into somebody's home.
            arguments = [one.replace("-write-", "-print-") for one in arguments if not one.startswith("~")]
            with pytest.raises(SystemExit) as end:
                cli._parsed(arguments)
            assert not end.value.code, f"{page}: {line}"
            continue
        try:
            assert isinstance(cli._parsed(arguments), cli._COMMANDS[arguments[0]])
        except SystemExit:
            pytest.fail(f"{page}: {line}\n{capsys.readouterr().err}")


def test_the_page_of_the_command_line_names_every_command_and_every_status():
    text = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
    for command in COMMANDS:
        assert re.search(rf"`{command}\b[^|]*\|", text), command
    for status in (0, 1, cli._USER, cli._OURS):
        assert f"| {status} |" in text
