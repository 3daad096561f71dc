"""Whoever works: what goes wrong in a cell costs that cell alone, and no bit depends on the workers."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import my_scores
import numpy as np
import odd_estimators
import pytest
import xarray as xr

from bodyimage_kin.errors import InvalidConfig, MissingDependency
from bodyimage_kin.estimators import LeastSquares
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Simulation, Study, calls, executors, read_study, summary
from bodyimage_kin.study.calls import Call
from bodyimage_kin.study.parts import parts_in
from bodyimage_kin.study.results import MISSING

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
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0", protocol="tcp://"
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
    with pytest.raises(calls.TimeLimitExceeded, match=r"time limit of 0\.2 s"):
        calls.here(Call(time.sleep, (3.0,), limit=0.2))
    assert time.monotonic() - begin < 2.0
    assert calls.here(Call(max, (1, 2), limit=5.0)) == 2
    with pytest.raises(ZeroDivisionError):
        calls.here(Call(divmod, (1, 0), limit=5.0))


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


# Whatever a cell does ------------------------------------------------------------------------------------------------

MISBEHAVING = {
    "raises": "ValueError: nothing to learn",
    "sleeps": "TimeLimitExceeded: took longer",
    "spins": "TimeLimitExceeded: took longer",
    "dies": "WorkerDied: the process ended with status 3",
    "kills itself": "WorkerDied: the process ended with status -9",
    "aborts": "WorkerDied: the process ended with status -6",
    "segfaults": "WorkerDied: the process ended with status -11",
    "stops": "TimeLimitExceeded: took longer",
    "asks": "EOFError",
    "closes all": "WorkerDied",
    "exits": "SystemExit: 3",
    "interrupts": "WorkerDied",
    "recurses": "RecursionError",
    "shouts": "ValueError: \\ud800éé",
    "cannot be said": "Unsayable",
    "forgets": "WrongResult: fit returned nothing",
    "leaks": "WrongResult: jacobian at probe 'on_face' holds",
    "nan": "WrongResult",
    "inf": "WrongResult",
    "raises late": "ValueError: asked too much",
    "shape": "WrongResult",
    "floods": "",
    "starts threads": "",
}


def misbehaving(**changes):
    ways = {way.replace(" ", "_"): {"odd_estimators:Odd": {"way": way}} for way in MISBEHAVING}
    # A sound one after each: nobody pays for a neighbour.
    rows = {name: spec for way, odd in ways.items() for name, spec in ((way, odd), (f"after_{way}", "LeastSquares"))}
    still = Simulation(Circle(turns=0.3), RandomTouch(duration=4.0), FaceTour(speed=0.2), dynamics=False)
    return Study("infant", {"still": still}, rows, seeds=1, probes=["on_face"], time_limit=5.0, **changes)


def check_misbehaving(found):
    said = {str(name): found["failure"].sel(estimator=name).item() for name in found["estimator"].values}
    for way, wanted in MISBEHAVING.items():
        name = way.replace(" ", "_")
        assert said[name].startswith(wanted), (way, said[name])
        assert said[f"after_{name}"] == "", (way, said[f"after_{name}"])
        assert len(said[name]) < 2100
    errors = found["relative_error"].squeeze()
    sound = errors.sel(estimator=[name for name in said if name.startswith("after_")])
    assert len(np.unique(sound)) == 1


@pytest.mark.slow
def test_what_misbehaves_in_a_pool_costs_itself(tmp_path, capfd):
    check_misbehaving(misbehaving().run(tmp_path, workers=2))
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_what_misbehaves_on_dask_with_threads_costs_itself(tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=":0") as cluster:
        check_misbehaving(misbehaving().run(tmp_path, cluster.scheduler_address))


@pytest.mark.slow
def test_what_a_cell_leaves_behind_costs_no_other_cell(tmp_path):
    rows = {
        "dies_later": odd_estimators.Odd("dies later"),
        "dawdles": odd_estimators.Odd("dawdles"),
        "dies": odd_estimators.Odd("dies"),
        "last": LeastSquares(),
    }
    still = Simulation(Circle(turns=0.5), RandomTouch(duration=4.0), FaceTour(speed=0.2), dynamics=False)
    found = Study("infant", {"still": still}, rows, seeds=1, probes=["on_face"]).run(tmp_path, workers=1)
    said = {str(name): found["failure"].sel(estimator=name).item() for name in found["estimator"].values}
    assert said.pop("dies").startswith("WorkerDied: the process ended with status 3")
    assert set(said.values()) == {""}, said


def test_small_cells_are_handed_out_together_and_fail_alone(tmp_path):
    """Those of which it is known that they take little time; one of them that hangs is found among the others."""
    still = Simulation(Circle(turns=0.5), RandomTouch(duration=4.0), FaceTour(speed=0.2), dynamics=False)
    rows = {f"row{number}": LeastSquares(scale=1 + number / 10) for number in range(12)}
    rows |= {"sleeps": odd_estimators.Odd("sleeps"), "dies": odd_estimators.Odd("dies"), "last": LeastSquares()}
    study = Study("infant", {"still": still}, rows, seeds=1, probes=["on_face"], time_limit=6.0)
    found = study.run(tmp_path, workers=1)
    said = {str(name): set(found["failure"].sel(estimator=name).values.ravel()) for name in found["estimator"].values}
    assert all("TimeLimitExceeded" in one for one in said.pop("sleeps"))
    assert all("status 3" in one for one in said.pop("dies"))
    assert set.union(*said.values()) == {""}
    shared = [len(list(parts_in(path))) for path in tmp_path.glob("cells/infant/still/*.parts")]
    assert sum(shared) == 15
    assert max(shared) > 2


def careless(*ways):
    rows = {way: my_scores.Careless(way) for way in ways}
    rows = {name: row for way, odd in rows.items() for name, row in ((way, odd), (f"after_{way}", LeastSquares()))}
    still = Simulation(Circle(turns=0.3), RandomTouch(duration=4.0), FaceTour(speed=0.2), dynamics=False)
    return Study("infant", {"still": still}, rows, seeds=1, probes=["on_face"])


@pytest.mark.parametrize("executor", [None, "in-process"])
def test_a_cell_prints_into_its_log_and_touches_no_other(executor, tmp_path, capfd):
    found = careless("prints", "closes", "changes").run(tmp_path, executor, workers=1)
    assert (found["failure"] == "").all()
    for score in ("relative_error", "attribution"):
        assert (
            len(np.unique(found[score].stack(all=[dim for dim in found[score].dims if dim != "part"]), axis=-1).T) == 1
        )
    log = tmp_path / "logs/infant/still/prints/block0.log"
    assert "said" in log.read_text()
    assert ("past Python" in log.read_text()) == (executor is None)
    assert "said" not in "".join(capfd.readouterr())
    # What prints nothing has no log.
    assert [path.parent.name for path in tmp_path.glob("logs/**/*.log")] == ["prints"]


def test_what_is_not_deterministic_is_noticed_on_request(tmp_path):
    rows = {"guesses": odd_estimators.Odd("guesses"), "flat": LeastSquares()}
    still = Simulation(Circle(turns=0.3), RandomTouch(duration=4.0), dynamics=False)
    study = Study("infant", {"still": still}, rows, seeds=2, probes=["on_face"])
    found = study.run(tmp_path / "twice", "in-process", twice=True)
    said = found["failure"].squeeze()
    assert said.sel(estimator="guesses").str.startswith("NotDeterministic").all()
    assert np.isnan(found["relative_error"].sel(estimator="guesses")).all()
    assert (said.sel(estimator="flat") == "").all()
    assert (study.run(tmp_path / "once", "in-process")["failure"] == "").all()


# The driver dies -----------------------------------------------------------------------------------------------------

HUNG = """
import sys
sys.path.insert(0, {tests!r})
import bodyimage_kin as bk
from bodyimage_kin.recordings.motions import Circle, RandomTouch
still = bk.study.Simulation(Circle(turns=0.3), RandomTouch(duration=4.0), dynamics=False)
rows = {{way: {{"odd_estimators:Odd": {{"way": way}}}} for way in ("sleeps", "spins")}}
bk.Study("infant", {{"still": still}}, rows, seeds=1, probes=["on_face"]).run({out!r}, workers=2)
"""


def children_of(process):
    """Processes that a process began, and theirs, by their numbers."""
    found, parents = set(), {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            number, _, rest = path.read_text().partition(" (")
        except OSError:
            continue
        parents[int(number)] = int(rest.rpartition(") ")[2].split()[1])
    new = {process}
    while new:
        new = {one for one, parent in parents.items() if parent in new} - found
        found |= new
    return found


def runs(process):
    """Whether a process is there and has not ended: one that nobody asked for its status yet has."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][0] not in "ZX"
    except OSError:
        return False


QUIET = (signal.SIGTERM, signal.SIGHUP)
"""They end a driver as SIGKILL and SIGINT do, one at once and one with a word."""


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="asks /proc")
@pytest.mark.parametrize(
    "by", [signal.SIGKILL, signal.SIGINT, *(pytest.param(s, marks=pytest.mark.slow) for s in QUIET)]
)
def test_children_end_with_the_driver_however_that_ends(by, tmp_path):
    # No `if __name__ == "__main__":` either: a plain script runs a study.
    script = tmp_path / "script.py"
    script.write_text(HUNG.format(tests=str(Path(__file__).parents[1]), out=str(tmp_path / "out")))
    end_with_children([sys.executable, str(script)], by, tmp_path)


def end_with_children(command, by, tmp_path):
    """Ends a study that hangs, once it does; the exit status, and what it said."""
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
    try:
        deadline = time.monotonic() + 90
        while not (tmp_path / "out/recordings/infant/still/block0.parts").exists():
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.2)
        time.sleep(2.0)
        children = children_of(process.pid)
        assert len(children) == 2
        process.send_signal(by)
        said = process.communicate(timeout=10)[1]
        deadline = time.monotonic() + 5
        while alive := [one for one in children if runs(one)]:
            assert time.monotonic() < deadline, alive
            time.sleep(0.1)
        return process.returncode, said
    finally:
        process.kill()


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="asks /proc")
@pytest.mark.parametrize(
    ("by", "status"),
    [(signal.SIGTERM, 143), pytest.param(signal.SIGHUP, 129, marks=pytest.mark.slow), (signal.SIGINT, 130)],
)
def test_the_command_ends_in_one_line_with_its_children(by, status, tmp_path):
    (tmp_path / "study.toml").write_text(
        'seeds = 1\nembodiments.infant = "infant"\nprobes.on_face = "on_face"\n'
        'estimators.a = {"odd_estimators:Odd" = {way = "sleeps"}}\n'
        'estimators.b = {"odd_estimators:Odd" = {way = "spins"}}\n'
        "[recordings.still]\ntraining.Circle = {turns = 0.3}\nuse.RandomTouch = {duration = 4.0}\ndynamics = false\n"
    )
    command = [sys.executable, "-m", "bodyimage_kin.cli", "study", str(tmp_path / "study.toml"), "--workers", "2"]
    found, said = end_with_children([*command, "--out", str(tmp_path / "out")], by, tmp_path)
    assert found == status
    assert said.splitlines()[-1] == "bodyimage-kin: interrupted; what is finished is kept"
    assert "Traceback" not in said


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_lost_scheduler_is_called_so_and_what_is_finished_is_kept(tmp_path):
    distributed = pytest.importorskip("distributed")
    still = Simulation(Circle(turns=0.3), RandomTouch(duration=4.0), dynamics=False)
    rows = {"flat": LeastSquares(), "slow": odd_estimators.Odd("sleeps")}
    study = Study("infant", {"still": still}, rows, seeds=1, probes=["on_face"])
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")

    def close():
        with contextlib.suppress(Exception):
            cluster.close()

    def told(done, total):
        if done == 2:
            threading.Thread(target=close, daemon=True).start()

    with pytest.raises(executors.ExecutorLost, match="the scheduler is lost; what is finished is kept"):
        study.run(tmp_path, cluster.scheduler_address, progress=told)
    said = read_study(tmp_path)["failure"].squeeze()
    assert said.values.tolist() == ["", MISSING]


KILLED = """
import sys
sys.path.insert(0, {tests!r})
import bodyimage_kin as bk
bk.Study.from_toml({file!r}).run({out!r}, {scheduler!r})
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_drivers_and_workers_of_dask_killed_at_any_moment_change_no_bit(tmp_path):
    distributed = pytest.importorskip("distributed")
    still = Simulation(Circle(turns=0.5), RandomTouch(duration=4.0), FaceTour(speed=0.2), dynamics=False)
    rows = {"flat": LeastSquares(), "slow": odd_estimators.Odd("dawdles"), "paper": {"PaperMLP": {"steps": 5}}}
    study = Study("infant", {"still": still}, rows, seeds=16, block=1, probes=["on_face"])
    wanted = study.run(tmp_path / "whole", "in-process")
    study.to_toml(tmp_path / "study.toml")
    rng, killed = np.random.default_rng(2), 0

    def files():
        return len(list((tmp_path / "out").rglob("*.parts")))

    def cluster():
        return distributed.LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=":0")

    with cluster() as one:
        script = KILLED.format(
            tests=str(Path(__file__).parents[1]),
            file=str(tmp_path / "study.toml"),
            out=str(tmp_path / "out"),
            scheduler=one.scheduler_address,
        )
        for number in range(20):
            before, deadline = files(), time.monotonic() + 60.0
            process = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
            # At work by now, or done.
            while process.poll() is None and files() == before and time.monotonic() < deadline:
                time.sleep(0.1)
            time.sleep(float(rng.uniform(0.0, 3.0)))
            running = [nanny for nanny in one.workers.values() if nanny.status.name == "running" and nanny.pid]
            for nanny in running if number % 2 and one.scheduler.workers else ():
                os.kill(nanny.pid, signal.SIGKILL)
                killed += 1
                time.sleep(1.0)
            killed += process.poll() is None
            process.kill()
            process.wait()
    assert killed
    with cluster() as another:
        found = study.run(tmp_path / "out", another.scheduler_address)
    xr.testing.assert_identical(found.drop_vars("fit_seconds"), wanted.drop_vars("fit_seconds"))
