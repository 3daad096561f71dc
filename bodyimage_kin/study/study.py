"""A study: every estimator, on every recording, in every embodiment, scored at every probe."""

from __future__ import annotations

import dataclasses
import functools
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w
import torch
import xarray as xr

from bodyimage_kin import _progress
from bodyimage_kin._checks import choice, flag, number, whole
from bodyimage_kin._files import write_text
from bodyimage_kin._shown import Shown
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.recordings import write_recording
from bodyimage_kin.study import asked, executors, results, running, specs, store
from bodyimage_kin.study.blocks import blocks
from bodyimage_kin.study.bodies import body_of
from bodyimage_kin.study.context import Score
from bodyimage_kin.study.fitness import refuse_unfit
from bodyimage_kin.study.grid import Row, row_of
from bodyimage_kin.study.scoring import PROBES, default_facts, default_scores, need_maps
from bodyimage_kin.study.specs import ESTIMATOR, Table
from bodyimage_kin.study.store import Store

__all__ = ["Study"]

_LARGEST_FILE = 4 * 2**20
"""Of a study's TOML file [bytes]."""


@dataclass(frozen=True)
class Study(Shown):
    """A grid of embodiments, recordings, estimators and seeds, each scored at every probe.

    Everything may be given as an object, a name or a table, and is kept as tables (:mod:`bodyimage_kin.study.specs`);
    two studies are equal when these are.

    Attributes:
        embodiments: An embodiment, or name -> embodiment: the object, a name, the path of a TOML file, a table
            ``{"embodiment": ..., "backend": ..., "mesh_folder": ...}``, or None where it is not known.
        recordings: Name -> motion, :class:`Simulation`, recording, or list of recordings, one a seed.
        estimators: A list, or name -> estimator or :class:`Row`.
        probes: A list, or name -> probe; None: those of the face only where they are not
            (:data:`bodyimage_kin.study.PROBES`).
        use: Motion of the touches of recordings that say nothing of it; None: see :class:`Simulation`.
        seeds: One recording each; a number n means 0 to n - 1.
        scores: Names of the scores to keep, or scores of one's own; those of maps are computed only when they are here.
            None: all that take little time; where it is handed recordings also errors of what is hidden in turn, whole
            blocks of a recording (``pair_error``, ``image_error``), for which each row learns once a fold.
        facts: Likewise of the facts.
        block: Seeds of a cell, which an estimator trains together. Part of what decides the result's last bits.
        seed: Of all random streams.
        excitation_cut: A direction counts as excited when training moves along it this much of what touching does.
        metric_of: ``"felt"`` or ``"true"``: whose motion the metric and the excitation are of.
        time_limit: Of a cell [s]; None: any time.
        per_posture: Whether scores are kept for each posture too, where ``scores`` does not say.
        first_maps: Initial weights of the maps that each recording is tried with; scores of maps are their means. Or
            seed -> number, 1 for all others.
        maps: Settings of :meth:`bodyimage_kin.BodyImage.learn`.
        labels: What pages and figures call names of the study: name -> label. They decide nothing else, and may change.
        folder: Where relative paths begin, and where modules may lie.
    """

    embodiments: Any
    recordings: Any
    estimators: Any
    probes: Any = None
    use: Any = None
    seeds: int | Sequence[int] = 30
    scores: Sequence[str | Score] | None = None
    facts: Sequence[str | Score] | None = None
    block: int = 10
    seed: int = 0
    excitation_cut: float = 0.1
    metric_of: str = "felt"
    time_limit: float | None = None
    per_posture: bool = False
    first_maps: int | Mapping[Any, int] = 1
    maps: Mapping[str, Any] = field(default_factory=dict)
    labels: Mapping[str, str] | None = None
    folder: Path = field(default=Path(), compare=False)
    _given: dict[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        put("folder", Path(self.folder))
        put("seeds", asked.seeds_of(self.seeds))
        for name in ("block", "seed"):
            put(name, whole(name, getattr(self, name), least=int(name == "block")))
        put("excitation_cut", number("excitation_cut", self.excitation_cut, least=0.0))
        if self.time_limit is not None:
            put("time_limit", number("time_limit", self.time_limit, above=0.0))
        choice("metric_of", self.metric_of, ("felt", "true"))
        flag("per_posture", self.per_posture)
        put("first_maps", asked.first_maps_of(self.first_maps))
        put("maps", asked.map_settings_of(self.maps))
        put("labels", asked.labels_of(self.labels) or None)
        read = asked.Reader(self.folder, self.seeds, self.use, self._given)  # type: ignore[arg-type]
        put("use", None)
        bodies = asked.named_bodies(self.embodiments)
        put("embodiments", {name: read.body(one) for name, one in bodies.items()})
        recordings = asked.named("recordings", self.recordings)
        put("recordings", {name: read.recording(name, one) for name, one in recordings.items()})
        given = any("recording" in one["training"] for one in self.recordings.values())
        put("scores", read.names("scores", self.scores, default_scores(self.per_posture, given)))
        with_maps = need_maps(self.scores or (), self.folder)
        put("facts", read.names("facts", self.facts, default_facts(self.per_posture, with_maps)))
        rows = asked.named("estimators", self.estimators, asked.row_name)
        for name, one in rows.items():
            self._refuse_other_bodies(name, one)
        put("estimators", {name: read.row(one) for name, one in rows.items()})
        probes = asked.named("probes", PROBES if self.probes is None else self.probes, asked.probe_key)
        put("probes", {name: read.probe(one) for name, one in probes.items()})
        known = [*self.recordings, *(f"{body}/{name}" for body in self.embodiments for name in self.recordings)]
        for name, row in self.estimators.items():
            for place in row.get("on", ()):
                if place not in known:
                    raise InvalidConfig(f"row '{name}': {UnknownName('recording', place, known)}")
        asked.refuse_infinite("study", self.table())

    # As a file ------------------------------------------------------------------------------------------------------

    def _rows(self) -> dict[str, str]:
        parts = ("embodiments", "recordings", "estimators", "probes", "scores", "facts")
        names = {name: ", ".join(map(str, getattr(self, name) or ())) or "none" for name in parts}
        return {**names, "seeds": f"{len(asked.seeds_of(self.seeds))}, in blocks of {self.block}"}

    def table(self) -> Table:
        """The study as one table, all that results keep of it; what it was handed stands as hashes."""
        names = [one.name for one in dataclasses.fields(self) if one.name not in ("folder", "_given", "use")]
        found = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in found.items()}

    def to_toml(self, path: str | Path) -> None:
        """Writes the study; :meth:`from_toml` reads exactly the same one.

        What the study was handed is written beside the file: recordings as NetCDF, embodiments as folders.
        """
        place = Path(path)
        names: dict[str, str] = {}
        for sha256, thing in self._given.items():
            if isinstance(thing, xr.Dataset):
                names[sha256] = f"recording_{sha256[:12]}.nc"
                write_recording(thing, place.parent / names[sha256])
            else:
                names[sha256] = f"embodiment_{sha256[:12]}/embodiment.toml"
                folder = place.parent / f"embodiment_{sha256[:12]}"
                folder.mkdir(exist_ok=True)
                for name, data in store.body_files(thing).items():
                    (folder / name).write_bytes(data)
        write_text(place, tomli_w.dumps(_with_paths(self.table(), names)))

    @classmethod
    def from_toml(cls, path: str | Path) -> Study:
        """The study in a TOML file; paths in it begin at the file's folder, and its modules may lie there.

        Raises:
            InvalidConfig: A file that cannot be read, or a field that is missing, unknown or out of range.
            UnknownName: An embodiment, estimator, probe or score that there is not.
        """
        place = Path(path)
        try:
            if place.stat().st_size > _LARGEST_FILE:
                raise InvalidConfig(f"study '{place.name}' has more than {_LARGEST_FILE} bytes; no study needs so many")
            source = place.read_bytes().decode()
            # A key of very many parts takes the reader of TOML minutes.
            plain = re.sub(r"\"(?:[^\"\\\n]|\\.)*\"|'[^'\n]*'", "q", source)
            if deep := re.search(r"(?:[^\s=\[\]{},.#]+\s*\.\s*){40}", plain):
                raise InvalidConfig(f"study '{place.name}': key '{deep[0][:40]}...' has more than 40 parts")
            table = tomllib.loads(source)
        except OSError as problem:
            raise InvalidConfig(f"cannot read study '{path}': {problem.strerror}") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as problem:
            raise InvalidConfig(f"study '{place.name}' is no valid TOML: {problem}") from None
        return cls.from_table(table, place.parent)

    @classmethod
    def from_table(cls, table: Mapping[str, Any], folder: Path = Path()) -> Study:
        """The study that :meth:`table` describes.

        Raises:
            InvalidConfig: As :meth:`from_toml`.
        """
        known = [one.name for one in dataclasses.fields(cls) if one.init and one.name != "folder"]
        specs.refuse_unknown("field of a study", table, known)
        asked.refuse_deep("study", table)
        for name in ("embodiments", "recordings", "estimators"):
            if name not in table:
                raise InvalidConfig(f"the study's field '{name}' is missing; give a table, NAME -> spec")
        return cls(**table, folder=folder)

    # At work --------------------------------------------------------------------------------------------------------

    def run(
        self,
        store: str | Path,
        executor: Any = None,
        *,
        workers: int | None = None,
        retry: bool = False,
        twice: bool = False,
        progress: bool | Callable[[int, int], None] = False,
    ) -> xr.Dataset:
        """Computes what is missing in a store, and gives everything.

        Args:
            store: Folder; new, empty, or of this very study, or of this study before it was added to: embodiments,
                recordings and estimators may be added, and seeds after complete blocks. Workers write into it, so it
                must be reachable from wherever they run.
            executor: None: a pool of processes; ``"in-process"``; a Dask scheduler's address or ``Client``; an
                ``Executor``. No bit of the result depends on it, ``fit_seconds`` aside.
            workers: Of the pool; None: one a processor.
            retry: Whether cells that failed are tried again.
            twice: Whether each cell is computed twice; a seed fails of which not the same comes, to the bit.
            progress: Whether a bar is shown; or called with the number of tasks that are done, and their total.

        Returns:
            Dims ``embodiment, recording, estimator, seed, probe`` (and ``part``, ``axis``, ``direction``,
            ``posture``). ``failure`` says what went wrong with a seed, whose scores are NaN; empty where nothing did.
            The attribute ``left_out`` says which scores there are not, where, and what they lack.

        Raises:
            InvalidConfig: A body of which no recording can say anything: its eye never sees the hand, its joints never
                move it; told before anything is computed, as ``bodyimage-kin embodiment check`` does.
            OutputRefused: A store of something else, or of a study with another config or robot; or one that cannot be
                written to.
            ExecutorLost: Nobody is left to work.
        """
        origin = self.origin()
        refuse_unfit({name: self._load(table) for name, table in self.embodiments.items()}, self.recordings)
        place = Store.claim(Path(store), origin, self.folder)
        place.give(self._given)
        shown = _progress.progress("tasks") if progress is True else nullcontext(progress or (lambda done, total: None))
        threads = torch.get_num_threads()
        try:
            with executors.executor(executor, workers) as working, shown as tell:
                running.work_off(
                    blocks({**origin, "folder": str(self.folder.absolute())}, place.folder),
                    self.estimators,
                    place,
                    working,
                    limit=self.time_limit,
                    retry=retry,
                    twice=twice,
                    tell=tell,
                )
        finally:
            # Cells worked off in this process compute with one.
            torch.set_num_threads(threads)
        # Not claimed again: another run may have let the store grow meanwhile.
        return results.gather(place, origin)

    def origin(self) -> Table:
        """All that decides the results: the config, and hashes of every embodiment and its URDF.

        Raises:
            InvalidConfig: An embodiment or an estimator that cannot be built.
        """
        bodies = {name: self._load(table) for name, table in self.embodiments.items()}
        others: set[str] = set()
        for body in bodies.values():
            # What a setting's value makes impossible is said before anything is computed.
            for table in self.estimators.values():
                row = row_of(table, self.folder)
                if row.estimator is not None and not row.told:
                    built = ESTIMATOR.build(row.estimator, self.folder, body)
                    others |= {
                        one.sha256 for one in specs.other_bodies(built) if body is None or one.sha256 != body.sha256
                    }
        return {
            "config": self.table(),
            **({"other_bodies_sha256": sorted(others)} if others else {}),
            "urdf_sha256": {name: body.robot.sha256 if body else "" for name, body in bodies.items()},
            "embodiment_sha256": {name: body.sha256 if body else "" for name, body in bodies.items()},
            "skin_shape": {
                name: list((body.skin.shape if body and body.skin else None) or ()) for name, body in bodies.items()
            },
        }

    def _refuse_other_bodies(self, row: str, given: Any) -> None:
        """Whoever wants a body is given the one that is studied; an object that was built with another says so."""
        own = list(specs.other_bodies(given.estimator if isinstance(given, Row) else given))
        if not own:
            return
        studied = {body.sha256 for table in self.embodiments.values() if (body := self._load(table)) is not None}
        for body in own:
            if body.sha256 not in studied:
                raise InvalidConfig(
                    f"row '{row}' was built with the body '{body.name}', which is none of the study's, and would be "
                    "given the study's instead; name it in a table, such as "
                    '{"SelfCalibration": {"body": "my.toml"}}'
                )

    def _load(self, table: Table) -> Embodiment | None:
        if "given" in table:
            if table["given"] not in self._given:
                raise InvalidConfig(
                    f"embodiment {table['given'][:12]} was handed to another study; give it to this one"
                )
            return self._given[table["given"]]
        return body_of(table, self.folder)


def _with_paths(value: Any, names: Mapping[str, str]) -> Any:
    """A table in which hashes of what was handed over are the names of its files."""
    if isinstance(value, Mapping):
        if list(value)[:1] == ["given"] and value["given"] in names:
            return {"embodiment": names[value["given"]], **{k: v for k, v in value.items() if k != "given"}}
        return {key: _with_paths(item, names) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_paths(item, names) for item in value]
    return names.get(value, value) if isinstance(value, str) else value
