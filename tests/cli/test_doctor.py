"""The doctor: right where all is right, and a failing check where a library computes something else."""

from __future__ import annotations

import contextlib
import io
import json
import re

import pytest

import bodyimage_kin as bk
from bodyimage_kin import cli
from bodyimage_kin.backends.mujoco_backend import MujocoBackend
from bodyimage_kin.backends.torch_backend import TorchBackend


@pytest.fixture(scope="module")
def healthy():
    with contextlib.redirect_stdout(io.StringIO()) as said:
        status = cli.main(["doctor", "--json"])
    return status, json.loads(said.getvalue())


def test_here_all_is_right(healthy):
    status, told = healthy
    assert status == 0
    assert told["healthy"] is True
    assert told["version"] == bk.__version__
    assert told["cores"] >= 1
    assert told["backends"] == bk.backends()
    assert told["packages"]["numpy"]
    assert set(told["extras"]) >= {"dask", "testing"}
    assert len(told["checks"]) >= 4 + sum(state == "installed" for state in told["backends"].values()) - 1
    assert all(check["error"] == "" and check["value"] <= check["limit"] for check in told["checks"])
    assert sum(check["seconds"] for check in told["checks"]) < 60.0


def test_a_library_that_computes_something_else_is_found(monkeypatch, capsys):
    right = TorchBackend.pose_and_jacobian

    def wrong(self, q, link):
        pose, jacobian = right(self, q, link)
        return pose, 1.000001 * jacobian

    def broken(self, q, link):
        raise RuntimeError("no such\nlibrary")

    monkeypatch.setattr(TorchBackend, "pose_and_jacobian", wrong)
    monkeypatch.setattr(MujocoBackend, "pose_and_jacobian", broken)
    assert cli.main(["doctor"]) == 1
    lines = capsys.readouterr().out.splitlines()
    failing = [line for line in lines if line.startswith("  FAILS")]
    assert len(failing) == 2
    assert re.search(r"Jacobians of torch against the oracle: [\d.]+e-0[67] is more than 1e-12", failing[0])
    assert "mujoco against the oracle: RuntimeError: no such library" in failing[1]
    assert lines[-1] == "wrong: see above"
