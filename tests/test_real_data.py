"""Where tests find real recordings, and that they say plainly when they find none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CONFTEST = Path(__file__).parent / "conftest.py"
CODE = """
def test_of_data(real_data, request):
    assert request.node.get_closest_marker("real_data")
    print(real_data)
"""


def outcome(folder: str | None, tmp_path: Path) -> str:
    """What pytest says of a test that takes the folder."""
    (tmp_path / "conftest.py").write_text(CONFTEST.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "test_it.py").write_text(CODE, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = real_data: as there\n", encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if name != "BODYIMAGE_KIN_DATA"}
    if folder is not None:
        environment["BODYIMAGE_KIN_DATA"] = folder
    command = [sys.executable, "-m", "pytest", "-rsP", "--strict-markers", "-p", "no:cacheprovider"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    return done.stdout + done.stderr


def test_the_folder_is_the_one_of_the_environment(tmp_path: Path) -> None:
    said = outcome(str(tmp_path), tmp_path)
    assert "1 passed" in said
    assert str(tmp_path) in said


def test_without_one_the_test_is_skipped_and_says_why(tmp_path: Path) -> None:
    said = outcome(None, tmp_path)
    assert "1 skipped" in said
    assert "no real recordings here: BODYIMAGE_KIN_DATA is not set" in said
