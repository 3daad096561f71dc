"""A study: every estimator, on every recording, in every embodiment, scored at every probe."""

from __future__ import annotations

import tomllib
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import torch
import xarray as xr

from bodyimage_kin._files import write_text
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.study import cells, executors, results, scores, specs, store
from bodyimage_kin.study.cells import Ground, Scene
from bodyimage_kin.study.specs import Table
from bodyimage_kin.study.store import Store

_MAPPINGS: Mapping[str, Callable[[Any], Table]] = {
    "embodiments": specs.embodiment_table,
    "recordings": specs.recording_table,
    "estimators": specs.estimator_table,
    "probes": specs.probe_table,
}
_IN_FLIGHT = 256
"""Tasks that wait at once: enough for a cluster, few enough for the memory that their recordings take."""


@dataclass(frozen=True)
class Study:
    """A grid of embodiments, recordings, estimators and seeds, each scored at every probe.

    Specs may be given as objects, names or tables, and are kept as tables (:mod:`bodyimage_kin.study.specs`); two
    studies are equal when these are.

    Attributes:
        embodiments: Name -> name of an embodiment, path of a TOML file, or ``{"embodiment": ..., "backend": ...}``.
        recordings: Name -> ``{"circle": settings, "touch": settings, "tour": settings}``.
        estimators: Name -> estimator, ``"package.module:Class"``, or ``{"PaperMLP": settings}``.
        seeds: One recording each; a number n means 0 to n - 1.
        probes: Name -> name of a probe, or ``{"face": {"distance": 0.03}}``.
        metrics: Names of the scores to keep; those of maps are computed only when they are named here.
        block: Seeds of a cell, which an estimator trains together. Part of what decides the result's last bits.
        seed: Of all random streams.
        excitation_cut: A direction counts as excited when training moves along it this much of what touching does.
        time_limit: Of a cell [s]; None: any time.
        per_posture: Whether scores are kept for each posture too.
        first_maps: Initial weights of the maps that each recording is tried with; scores of maps are their means.
        folder: Where relative paths of embodiments begin.
    """

    embodiments: Mapping[str, Any]
    recordings: Mapping[str, Any]
    estimators: Mapping[str, Any]
    seeds: int | Sequence[int] = 30
    probes: Mapping[str, Any] = field(default_factory=lambda: dict(specs.PROBES))
    metrics: Sequence[str] = scores.DEFAULT
    block: int = 10
    seed: int = 0
    excitation_cut: float = 0.1
    time_limit: float | None = None
    per_posture: bool = False
    first_maps: int = 1
    folder: Path = field(default=Path(), compare=False)

    def __post_init__(self) -> None:
        for name, canonical in _MAPPINGS.items():
            value = getattr(self, name)
            if not isinstance(value, Mapping) or not value:
                raise InvalidConfig(f"{name}: give at least one, NAME -> spec")
            tables = {specs.plain_name(name.removesuffix("s"), key): canonical(spec) for key, spec in value.items()}
            object.__setattr__(self, name, tables)
        seeds = range(self.seeds) if isinstance(self.seeds, int) else self.seeds
        object.__setattr__(self, "seeds", tuple(seeds))
        object.__setattr__(self, "metrics", tuple(self.metrics))
        object.__setattr__(self, "folder", Path(self.folder))
        self._check()

    def _check(self) -> None:
        seeds: Sequence[Any] = self.all_seeds
        if not seeds or len(set(seeds)) != len(seeds) or not all(_is_whole(seed) for seed in (*seeds, self.seed)):
            raise InvalidConfig(f"seeds={seeds!r}, seed={self.seed!r}: give whole numbers of at least 0, none twice")
        if not _is_whole(self.block) or self.block < 1:
            raise InvalidConfig(f"block={self.block!r}: give a whole number of at least 1")
        if not _is_whole(self.first_maps) or self.first_maps < 1:
            raise InvalidConfig(f"first_maps={self.first_maps!r}: give a whole number of at least 1")
        if self.time_limit is not None and not 0 < self.time_limit < np.inf:
            raise InvalidConfig(f"time_limit={self.time_limit!r}: give a positive number of seconds, or None")
        if not 0 <= self.excitation_cut < np.inf:
            raise InvalidConfig(f"excitation_cut={self.excitation_cut!r}: give a number that is not negative")
        if not isinstance(self.per_posture, bool):
            raise InvalidConfig(f"per_posture={self.per_posture!r}: give true or false")
        for name in self.metrics:
            if name not in scores.SCORES:
                raise UnknownName("metric", name, scores.SCORES)

    @property
    def all_seeds(self) -> tuple[int, ...]:
        """Every seed."""
        return tuple(self.seeds)  # type: ignore[arg-type]

    # As a file ------------------------------------------------------------------------------------------------------

    def table(self) -> Table:
        """The study as one table, all that TOML and results keep of it."""
        found: Table = {
            "seeds": list(self.all_seeds),
            "block": self.block,
            "seed": self.seed,
            "excitation_cut": self.excitation_cut,
            "per_posture": self.per_posture,
            "first_maps": self.first_maps,
            "metrics": list(self.metrics),
        }
        if self.time_limit is not None:
            found["time_limit"] = self.time_limit
        return found | {name: dict(getattr(self, name)) for name in _MAPPINGS}

    def to_toml(self, path: str | Path) -> None:
        """Writes the study; :meth:`from_toml` reads exactly the same one."""
        write_text(Path(path), tomli_w.dumps(self.table()))

    @classmethod
    def from_toml(cls, path: str | Path) -> Study:
        """The study in a TOML file; paths in it begin at the file's folder.

        Raises:
            InvalidConfig: A file that cannot be read, or a field that is missing, unknown or out of range.
            UnknownName: An embodiment, estimator, probe or metric that there is not.
        """
        place = Path(path)
        try:
            table = tomllib.loads(place.read_bytes().decode())
        except OSError as problem:
            raise InvalidConfig(f"cannot read study '{path}': {problem.strerror}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
            raise InvalidConfig(f"study '{place.name}' is no valid TOML: {problem}") from None
        return cls.from_table(table, place.parent)

    @classmethod
    def from_table(cls, table: Mapping[str, Any], folder: Path = Path()) -> Study:
        """The study that :meth:`table` describes.

        Raises:
            InvalidConfig: As :meth:`from_toml`.
        """
        known = [name for name in cls.__dataclass_fields__ if name != "folder"]
        for name in table:
            if name not in known:
                raise InvalidConfig(str(UnknownName("field of a study", name, known)))
        for name in ("embodiments", "recordings", "estimators"):
            if name not in table:
                raise InvalidConfig(f"the study's field '{name}' is missing; give a table, NAME -> spec")
        return cls(**table, folder=folder)

    # At work --------------------------------------------------------------------------------------------------------

    def origin(self) -> dict[str, Any]:
        """All that decides the results: the config, and hashes of every embodiment and its URDF."""
        bodies = {name: self._load(name) for name in self.embodiments}
        return {
            "config": self.table(),
            "urdf_sha256": {name: body.robot.sha256 for name, body in bodies.items()},
            "embodiment_sha256": {name: body.sha256 for name, body in bodies.items()},
            "skin_shape": {name: list(body.require_skin().shape) for name, body in bodies.items()},
        }

    def run(
        self,
        store: str | Path,
        executor: Any = None,
        *,
        workers: int | None = None,
        retry: bool = False,
        report: Callable[[int, int], None] = lambda done, total: None,
    ) -> xr.Dataset:
        """Computes what is missing in a store, and gives everything.

        Args:
            store: Folder; new, empty, or of this very study, or of this study before it was added to: embodiments,
                recordings and estimators may be added, and seeds after complete blocks.
            executor: None: a pool of processes; ``"in-process"``; a Dask scheduler's address or ``Client``; an
                ``Executor``. No bit of the result depends on it, ``fit_seconds`` aside.
            workers: Of the pool; None: one a processor.
            retry: Whether cells that failed are tried again.
            report: Called with the number of tasks that are done, and their total.

        Returns:
            Dims ``embodiment, recording, estimator, seed, probe`` (and ``part``, ``axis``, ``direction``,
            ``posture``). ``failure`` says what went wrong with a seed, whose scores are NaN; empty where nothing did.

        Raises:
            OutputRefused: A store of something else, or of a study with another config or robot.
        """
        origin = self.origin()
        place = Store.claim(Path(store), origin, self.folder)
        threads = torch.get_num_threads()
        try:
            with executors.executor(executor, workers) as working:
                _Run(self, place, origin, working, retry, report).work()
        finally:
            # Cells worked off in this process compute with one.
            torch.set_num_threads(threads)
        # Not claimed again: another run may have let the store grow meanwhile.
        return results.gather(self, place, origin)

    def gather(self, store: str | Path) -> xr.Dataset:
        """What a store holds of this study; cells that are missing count as failed.

        Raises:
            OutputRefused: As :meth:`run`.
        """
        origin = self.origin()
        place = Store.claim(Path(store), origin, self.folder)
        return results.gather(self, place, origin)

    def grounds(self, origin: Mapping[str, Any]) -> Iterator[tuple[int, Ground]]:
        """Every block of every recording of every embodiment, and the number of the block."""
        blocks = [self.all_seeds[first : first + self.block] for first in range(0, len(self.all_seeds), self.block)]
        for embodiment in self.embodiments:
            body = dict(self.embodiments[embodiment], embodiment=self._place(embodiment))
            for recording, motions in self.recordings.items():
                for number, seeds in enumerate(blocks):
                    yield (
                        number,
                        Ground(
                            embodiment=embodiment,
                            recording=recording,
                            seeds=seeds,
                            body=body,
                            sha256=origin["embodiment_sha256"][embodiment],
                            motions=motions,
                            probes=self.probes,
                            entropy=self.seed,
                            excitation_cut=self.excitation_cut,
                            per_posture=self.per_posture,
                            first_maps=self.first_maps if set(self.metrics) & set(scores.MAP_SCORES) else 0,
                        ),
                    )

    def _place(self, embodiment: str) -> str:
        """Name of an embodiment, or its path from here."""
        named: str = self.embodiments[embodiment]["embodiment"]
        return str((self.folder / named).absolute()) if named.endswith(".toml") else named

    def _load(self, embodiment: str) -> Any:
        return load_embodiment(self._place(embodiment), self.embodiments[embodiment].get("backend"))


@dataclass(frozen=True, eq=False)
class _Task:
    """Something to hand out: the scene of a ground, or one estimator's cell on it."""

    block: int
    ground: Ground
    estimator: str | None = None
    scene: Scene | None = None


class _Run:
    """One run: hands out tasks, writes what comes back at once."""

    def __init__(
        self,
        study: Study,
        store: Store,
        origin: Mapping[str, Any],
        executor: Executor,
        retry: bool,
        report: Callable[[int, int], None],
    ) -> None:
        self.study, self.store, self.executor, self.report = study, store, executor, report
        self.attributes = results.attributes(origin)
        self.missing: dict[tuple[str, str, int], list[str]] = {}
        self.tasks: deque[_Task] = deque()
        self.done = self.total = 0
        for block, ground in study.grounds(origin):
            missing = [name for name in study.estimators if self._is_missing(block, ground, name, retry)]
            if missing:
                self.missing[ground.embodiment, ground.recording, block] = missing
                self.tasks.append(_Task(block, ground))
                self.total += 1 + len(missing)

    def work(self) -> None:
        """Until nothing is missing."""
        most = 1 if isinstance(self.executor, executors.InProcess) else _IN_FLIGHT
        pending: dict[Future[Any], _Task] = {}
        self.report(0, self.total)
        try:
            while self.tasks or pending:
                while self.tasks and len(pending) < most:
                    task = self.tasks.popleft()
                    if task.scene is None and self.store.scene(task.ground, task.block).exists():
                        self._stand_on(task, self.store.read_scene(task.ground, task.block))
                    else:
                        pending[self._submit(task)] = task
                for future in wait(pending, return_when=FIRST_COMPLETED).done if pending else ():
                    self._take(pending.pop(future), future)
        finally:
            for future in pending:
                future.cancel()

    def _is_missing(self, block: int, ground: Ground, estimator: str, retry: bool) -> bool:
        path = self.store.cell(ground, block, estimator)
        return not path.exists() or (retry and bool((store.read(path)["failure"] != "").any()))

    def _submit(self, task: _Task) -> Future[Any]:
        limit = self.study.time_limit
        if task.scene is None or task.estimator is None:
            return executors.submit(self.executor, None, None, cells.make_scene, task.ground)
        table = self.study.estimators[task.estimator]
        arguments = task.ground, task.scene, task.estimator, table, self.study.metrics
        return executors.submit(self.executor, limit, cells.load_body, cells.run_cell, *arguments)

    def _take(self, task: _Task, future: Future[Any]) -> None:
        problem = future.exception()
        if isinstance(problem, executors.NoWorker):
            raise problem
        if task.estimator is not None:
            found = (
                future.result()
                if problem is None
                else cells.failed(task.ground, self.study.metrics, cells.describe(problem))
            )
            self._write(task, task.estimator, found)
            return
        scene = cells.describe(problem) if problem is not None else future.result()
        if isinstance(scene, Scene):
            self.store.write_scene(task.ground, task.block, scene, self.attributes)
            recordings = {role: scene.recordings[role] for role in task.ground.roles}
            self._stand_on(task, Scene(recordings, scene.facts))
            return
        self._done()
        for name in self._missing(task):
            failed = cells.failed(task.ground, self.study.metrics, f"no recordings: {scene}")
            self._write(task, name, failed)

    def _stand_on(self, task: _Task, scene: Scene) -> None:
        """The ground is there: its cells come next."""
        self._done()
        self.tasks.extendleft(_Task(task.block, task.ground, name, scene) for name in reversed(self._missing(task)))

    def _missing(self, task: _Task) -> list[str]:
        return self.missing[task.ground.embodiment, task.ground.recording, task.block]

    def _write(self, task: _Task, estimator: str, found: xr.Dataset) -> None:
        store.write(found.assign_attrs(self.attributes), self.store.cell(task.ground, task.block, estimator))
        self._done()

    def _done(self) -> None:
        self.done += 1
        self.report(self.done, self.total)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
