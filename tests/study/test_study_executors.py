"""Whoever works: what goes wrong in a cell costs that cell alone, and no bit depends on the workers."""

from __future__ import annotations

import time

import numpy as np
import odd_estimators
import pytest
import xarray as xr

from bodyimage_kin.errors import InvalidConfig, MissingDependency
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Simulation, Study, executors, summary
from bodyimage_kin.study.executors import Call

WAYS = ("raises", "nan", "shape", "sleeps", "dies")


@pytest.fixture(scope="module")
def asked():
    """Odd estimators, and one between them that is not."""
    odd = {way: odd_estimators.Odd(way) for way in WAYS}
    return Study(
        embodiments={"infant": "infant"},
        recordings={
            "still": Simulation(Circle(turns=0.5), RandomTouch(duration=5.0), FaceTour(speed=0.2), dynamics=False)
        },
        estimators={**odd, "paper": {"PaperMLP": {"steps": 20}}},
        seeds=1,
        time_limit=6.0,
    )


@pytest.fixture(scope="module")
def by_pool(asked, tmp_path_factory):
    return asked.run(tmp_path_factory.mktemp("pool"), workers=1)


def test_what_goes_wrong_costs_its_own_cell_only(by_pool):
    said = by_pool["failure"].isel(embodiment=0, recording=0, seed=0)
    for way, wanted in {
        "raises": "ValueError: nothing to learn",
        "nan": "WrongResult: displacement on the tour is not finite in",
        "shape": "WrongResult: displacement on the tour has shape",
        "sleeps": "TimeLimitExceeded: took longer than the time limit of 6 s",
        "dies": "WorkerDied: the process ended with status 3: a crash, or no memory left",
    }.items():
        assert said.sel(estimator=way).item().startswith(wanted)
    assert said.sel(estimator="paper").item() == ""
    errors = by_pool["relative_error"].isel(embodiment=0, recording=0, seed=0)
    assert np.isfinite(errors.sel(estimator="paper")).all()
    assert np.isnan(errors.sel(estimator=list(WAYS))).all()
    assert [one["estimator"] for one in summary.failures(by_pool)] == list(WAYS)


def test_no_bit_depends_on_who_works(asked, by_pool, tmp_path):
    quick = {name: table for name, table in asked.estimators.items() if name not in ("sleeps", "dies")}
    study = Study(**{**asked.table(), "estimators": quick})
    found = study.run(tmp_path / "here", "in-process").drop_vars("fit_seconds").drop_attrs()
    xr.testing.assert_identical(found, by_pool.sel(estimator=list(quick)).drop_vars("fit_seconds").drop_attrs())


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_dask_cluster_works_off_a_study(asked, by_pool, tmp_path):
    distributed = pytest.importorskip("distributed")
    quick = {name: table for name, table in asked.estimators.items() if name in ("raises", "paper")}
    study = Study(**{**asked.table(), "estimators": quick})
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, protocol="tcp://"
    ) as cluster:
        found = study.run(tmp_path / "address", cluster.scheduler_address)
        with distributed.Client(cluster) as client:
            # What is there already is not computed again.
            again = study.run(tmp_path / "address", client)
    xr.testing.assert_identical(again, found)
    xr.testing.assert_identical(
        found.drop_vars("fit_seconds").drop_attrs(),
        by_pool.sel(estimator=list(quick)).drop_vars("fit_seconds").drop_attrs(),
    )


def test_where_nothing_can_be_killed_it_is_given_up():
    begin = time.monotonic()
    with pytest.raises(executors.TimeLimitExceeded, match=r"time limit of 0\.2 s"):
        executors.here(Call(time.sleep, (3.0,), limit=0.2))
    assert time.monotonic() - begin < 2.0
    assert executors.here(Call(max, (1, 2), limit=5.0)) == 2
    with pytest.raises(ZeroDivisionError):
        executors.here(Call(divmod, (1, 0), limit=5.0))


def test_a_pool_goes_on_after_an_error():
    pool = executors.KillablePool(1)
    wrong, fine = pool.submit(divmod, 1, 0), pool.submit(max, 1, 2)
    late = pool.hand_out(Call(max, ([], 3), len, 60.0))
    pool.shutdown()
    assert str(wrong.exception()).startswith("ZeroDivisionError")
    assert fine.result() == 2
    assert isinstance(late.exception(), RuntimeError)


def test_an_executor_that_is_none_is_named(tmp_path):
    with pytest.raises(InvalidConfig, match="executor 'dask'"), executors.executor("dask"):
        pass
    with pytest.raises(InvalidConfig, match="workers=0"), executors.executor(None, 0):
        pass


def test_dask_is_asked_for_when_it_is_missing(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(MissingDependency, match=r"bodyimage-kin\[dask\]"), executors.executor("tcp://127.0.0.1:1"):
        pass
