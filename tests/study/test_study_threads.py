"""A study on a pool of threads: each thread asks the same body of the same backend, and none gets another's values."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr

from bodyimage_kin.recordings.motions import Circle
from bodyimage_kin.study import Simulation, Study


@pytest.fixture
def quick_switches():
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("quick_switches")
@pytest.mark.parametrize("backend", ["mujoco", "pinocchio"])
def test_the_analytic_jacobian_is_right_on_threads(backend, tmp_path):
    study = Study(
        embodiments={"infant": {"embodiment": "infant", "backend": backend}},
        recordings={"near": Simulation(Circle(turns=0.1), use="none", tour="none", dynamics=False)},
        estimators={"analytic": "Analytic", "known": "Analytic", "again": "Analytic"},
        scores=["relative_error", "max_oracle_difference"],
        probes={"space": {"JointSpace": {"count": 400}}},
        seeds=2,
        block=1,
    )  # fmt: skip
    with ThreadPoolExecutor(4) as threads:
        found = study.run(tmp_path / "threads", threads)
    assert (found["failure"] == "").all()
    assert float(found["relative_error"].max()) < 1e-12
    assert float(found["max_oracle_difference"].max()) < 1e-12
    alone = study.run(tmp_path / "alone", "in-process")
    changing = ["fit_seconds"] if "fit_seconds" in found else []
    xr.testing.assert_identical(found.drop_vars(changing).drop_attrs(), alone.drop_vars(changing).drop_attrs())
    assert np.isfinite(found["relative_error"]).all()
