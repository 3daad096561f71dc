"""A study: every estimator, on every recording, in every embodiment, scored at every probe."""

from __future__ import annotations

import dataclasses
import inspect
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
from bodyimage_kin._checks import choice, flag, number, refuse, whole
from bodyimage_kin._files import write_text
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import embodiments as known_embodiments
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.body_image import BodyImage
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.recordings import Drag, Noise, motions, read_recording, write_recording
from bodyimage_kin.study import cells, executors, results, running, scores, specs, store
from bodyimage_kin.study.grid import ROLES, Row, Simulation, blocks
from bodyimage_kin.study.scores import Score
from bodyimage_kin.study.scoring import PROBES, built_probe, probe_name
from bodyimage_kin.study.specs import ESTIMATOR, MOTION, PROBE, Table
from bodyimage_kin.study.store import Store

_TOUCH_DURATION = 80.0
"""Time of touching [s]; by then the motion's metric has settled to a few per cent. Maps take ten times as long."""
_SHARED = ("speed", "sampling", "rest_spread", "rest_pull")
"""Settings that touch and tour take over from the motion learned from, where a study says nothing of them."""
_MOST_SEEDS = 10**6
_LARGEST_FILE = 4 * 2**20
"""Of a study's TOML file [bytes]."""
_GIVEN_BY_US = ("exp", "hand", "trial", "grid", "seed", "image_range", "posture_som", "initial_map")
"""Parameters of :meth:`BodyImage.learn` that no row sets."""


@dataclass(frozen=True)
class Study:
    """A grid of embodiments, recordings, estimators and seeds, each scored at every probe.

    Everything may be given as an object, a name or a table, and is kept as tables (:mod:`bodyimage_kin.study.specs`);
    two studies are equal when these are.

    Attributes:
        embodiments: An embodiment, or name -> embodiment: the object, a name, the path of a TOML file, a table
            ``{"embodiment": ..., "backend": ...}``, or None where it is not known.
        recordings: Name -> motion, :class:`Simulation`, recording, or list of recordings, one a seed.
        estimators: A list, or name -> estimator or :class:`Row`.
        probes: A list, or name -> probe; None: those of the face only where they are not
            (:data:`bodyimage_kin.study.PROBES`).
        use: Motion of the touches of recordings that say nothing of it; None: see :class:`Simulation`.
        seeds: One recording each; a number n means 0 to n - 1.
        scores: Names of the scores to keep, or scores of one's own; those of maps are computed only when they are here.
            None: all that take little time.
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
        streams: ``"own"``: random streams spawned by name; ``"plain"``: every stream is seeded by the seed itself.
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
    streams: str = "own"
    folder: Path = field(default=Path(), compare=False)
    _given: dict[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        put("folder", Path(self.folder))
        put("seeds", _seeds(self.seeds))
        for name in ("block", "seed"):
            put(name, whole(name, getattr(self, name), least=int(name == "block")))
        put("excitation_cut", number("excitation_cut", self.excitation_cut, least=0))
        if self.time_limit is not None:
            put("time_limit", number("time_limit", self.time_limit, above=0))
        choice("metric_of", self.metric_of, ("felt", "true"))
        choice("streams", self.streams, ("own", "plain"))
        flag("per_posture", self.per_posture)
        put("first_maps", _first_maps(self.first_maps))
        put("maps", _map_settings(self.maps))
        put("scores", self._named("scores", self.scores, scores.default_scores(self.per_posture)))
        with_maps = scores.need_maps(self.scores or (), self.folder)
        put("facts", self._named("facts", self.facts, scores.default_facts(self.per_posture, with_maps)))
        put("embodiments", {k: self._body_table(v) for k, v in _named_bodies(self.embodiments).items()})
        put("recordings", {k: self._recording_table(k, v) for k, v in _mapping("recordings", self.recordings).items()})
        put("estimators", {k: self._row_table(v) for k, v in _mapping("estimators", self.estimators, _row_name).items()})
        given = PROBES if self.probes is None else self.probes
        put("probes", {k: PROBE.table(self._probe(v)) for k, v in _mapping("probes", given, _probe_key).items()})
        put("use", None)
        for name, row in self.estimators.items():
            for place in row.get("on", ()):
                self._check_place(name, place)
        specs.finite("study", self.table())

    # As a file ------------------------------------------------------------------------------------------------------

    def table(self) -> Table:
        """The study as one table, all that results keep of it; recordings that were handed over stand as their hashes."""
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
            if deep := re.search(r"(?:[^\s=\[\]{},.#]+\s*\.\s*){40}", source):
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
        specs.refuse_deep("study", table)
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
            progress: Whether a bar is shown; or called with the number of tasks that are done, and their total.

        Returns:
            Dims ``embodiment, recording, estimator, seed, probe`` (and ``part``, ``axis``, ``direction``,
            ``posture``). ``failure`` says what went wrong with a seed, whose scores are NaN; empty where nothing did.
            The attribute ``left_out`` says which scores there are not, where, and what they lack.

        Raises:
            OutputRefused: A store of something else, or of a study with another config or robot; or one that cannot be
                written to.
            ExecutorLost: Nobody is left to work.
        """
        origin = self.origin()
        place = Store.claim(Path(store), origin, self.folder)
        place.give(self._given)
        shown = _progress.progress("tasks") if progress is True else nullcontext(progress or (lambda done, total: None))
        threads = torch.get_num_threads()
        try:
            with executors.executor(executor, workers) as working, shown as report:
                running.work_off(
                    blocks({**origin, "folder": str(self.folder.absolute())}, place.folder),
                    self.estimators,
                    place,
                    working,
                    limit=self.time_limit,
                    retry=retry,
                    report=report,
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
        for body in bodies.values():
            # What a setting's value makes impossible is said before anything is computed.
            for table in self.estimators.values():
                row = cells.row_of(table, self.folder)
                if row.estimator is not None and not row.told:
                    ESTIMATOR.build(row.estimator, self.folder, body)
        return {
            "config": self.table(),
            "urdf_sha256": {name: body.robot.sha256 if body else "" for name, body in bodies.items()},
            "embodiment_sha256": {name: body.sha256 if body else "" for name, body in bodies.items()},
            "skin_shape": {name: list(body.skin.shape) if body and body.skin else [] for name, body in bodies.items()},
        }

    def _load(self, table: Table) -> Embodiment | None:
        if "given" in table:
            if table["given"] not in self._given:
                raise InvalidConfig(f"embodiment {table['given'][:12]} was handed to another study; give it to this one")
            return self._given[table["given"]]  # type: ignore[no-any-return]
        place = cells.body_place(table, self.folder, Path())
        return load_embodiment(place, table.get("backend")) if place else None

    # Tables of what is given ----------------------------------------------------------------------------------------

    def _named(self, what: str, given: Any, otherwise: Sequence[str]) -> tuple[str, ...]:
        """Scores or facts as they are written, each once."""
        if given is None:
            return tuple(otherwise)
        if isinstance(given, str | Mapping) or not isinstance(given, Sequence):
            refuse(what, given, "a list of names")
        if what == "scores" and not given:
            refuse(what, given, "at least one name")
        return tuple(dict.fromkeys(scores.written(one, self.folder) for one in given))

    def _body_table(self, spec: Any) -> Table:
        """``{"embodiment": NAME or PATH}``, with ``backend`` where one is chosen; empty: it is not known."""
        if spec is None:
            return {}
        if isinstance(spec, Embodiment):
            backend = {"backend": spec.kinematics.name}
            if spec.name in known_embodiments():
                own = load_embodiment(spec.name)
                if own.sha256 == spec.sha256:
                    return {"embodiment": spec.name} | (backend if own.kinematics.name != spec.kinematics.name else {})
            store.body_files(spec)
            self._given[spec.sha256] = spec
            return {"given": spec.sha256, **backend}
        table = {"embodiment": spec} if isinstance(spec, str | Path) else spec
        if not isinstance(table, Mapping):
            refuse("embodiment", spec, "an embodiment, its name, the path of a TOML file, or {embodiment, backend}")
        specs.refuse_unknown("setting of embodiment", table, ("embodiment", "backend", "given"))
        found = {key: str(value) if isinstance(value, Path) else value for key, value in table.items()}
        if not all(isinstance(value, str) for value in found.values()) or (found and len(found.keys() - {"backend"}) != 1):
            refuse("embodiment", spec, "a name, the path of a TOML file, or {embodiment, backend}")
        return found

    def _recording_table(self, name: str, spec: Any) -> Table:
        """Settings of a :class:`Simulation`, every one written out, recordings as their hashes."""
        what = f"recording '{name}'"
        if isinstance(spec, Mapping) and "training" in spec:
            specs.refuse_unknown(f"setting of {what}", spec, [one.name for one in dataclasses.fields(Simulation)])
            parts = dict(spec)
        elif isinstance(spec, Simulation):
            parts = dict(vars(spec))
        else:
            parts = {"training": spec}
        training = self._role(f"{what}: training", parts["training"], several=True)
        simulated = isinstance(training, list) or "recording" not in training
        first = (training[0] if isinstance(training, list) else training) if simulated else None
        found: Table = {"training": training}
        for role, given in (("use", parts.get("use")), ("tour", parts.get("tour"))):
            given = self.use if given is None and role == "use" else given
            if given is None and first is not None:
                shared = {key: value for key, value in next(iter(first.values())).items() if key in _SHARED}
                given = motions.RandomTouch(duration=_TOUCH_DURATION, **shared) if role == "use" else motions.FaceTour(**shared)
            if given is not None:
                found[role] = given if given == "none" else self._role(f"{what}: {role}", given)
        dynamics = parts.get("dynamics", True)
        dynamics = dynamics if dynamics is False else specs.from_settings(Drag, {} if dynamics is True else dynamics, what=f"{what}: dynamics")
        noise = specs.from_settings(Noise, parts.get("noise") or {}, what=f"{what}: noise")
        if noise.torque and dynamics is False:
            raise InvalidConfig(f"{what}: noise: torque={noise.torque:g} disturbs an arm that is dragged; use dynamics=true")
        written = False if dynamics is False else specs.settings_of(dynamics)
        found |= {"dynamics": written, "noise": specs.settings_of(noise)}
        checked = Simulation(None, dynamics=dynamics, noise=noise, stream=parts.get("stream", ""))
        use = found.get("use")
        if first is not None and isinstance(use, Mapping) and "recording" not in use:
            ours, theirs = (next(iter(one.values())).get("sampling") for one in (first, use))
            if ours != theirs:
                raise InvalidConfig(f"{what}: use: sampling must be that of the training, {ours}; or displacements differ")
        return found | ({"stream": checked.stream} if checked.stream else {})

    def _role(self, what: str, given: Any, several: bool = False) -> Any:
        """A motion's table, a list of them, or ``{"recording": hash, or one a seed}``."""
        if isinstance(given, Mapping) and list(given) == ["recording"]:
            given = given["recording"]
            if isinstance(given, str | list) and all(_is_hash(one) for one in ([given] if isinstance(given, str) else given)):
                return {"recording": given}
        many = list(given) if isinstance(given, list | tuple) else [given]
        if not many:
            refuse(what, given, "a motion or a recording")
        if all(isinstance(one, xr.Dataset) or _is_path(one) for one in many):
            hashes = [self._keep(one) for one in many]
            if len(hashes) not in (1, len(self.seeds)):  # type: ignore[arg-type]
                raise InvalidConfig(f"{what}: {len(hashes)} recordings for {len(self.seeds)} seeds; give one a seed")  # type: ignore[arg-type]
            return {"recording": hashes if len(hashes) > 1 else hashes[0]}
        if len(many) > 1 and not several:
            refuse(what, given, "one motion, or recordings")
        tables = [MOTION.table(one, self.folder) for one in many]
        return tables if len(tables) > 1 else tables[0]

    def _keep(self, given: xr.Dataset | str | Path) -> str:
        recording = given if isinstance(given, xr.Dataset) else read_recording(self.folder / given)
        sha256 = store.fingerprint(recording)
        self._given[sha256] = recording
        return sha256

    def _row_table(self, spec: Any) -> Table:
        """An estimator's table; of a row that says more, ``{"estimator": table, ...}`` with what differs."""
        if isinstance(spec, Mapping) and "estimator" in spec:
            specs.refuse_unknown("setting of a row", spec, [one.name for one in dataclasses.fields(Row)])
            row = cells.row_of(spec, self.folder)
        else:
            row = spec if isinstance(spec, Row) else Row(spec)
        estimator = None if row.estimator is None else ESTIMATOR.table(row.estimator, self.folder)
        others = {key: value for key, value in specs.settings_of(row).items() if key != "estimator"}
        others = {key: value for key, value in others.items() if value != specs.settings_of(Row())[key]} if others else {}
        if "first_maps" in others:
            others["first_maps"] = _first_maps(row.first_maps)
        if "maps" in others:
            others["maps"] = _map_settings(row.maps)
        for setting, fact in row.told.items():
            scores.resolve(fact, self.folder)
            self._check_told(row.estimator, setting)
        return estimator if estimator is not None and not others else {"estimator": estimator or "none", **others}

    def _check_told(self, estimator: Any, setting: str) -> None:
        name, _ = ESTIMATOR.parts(ESTIMATOR.table(estimator, self.folder))
        known = inspect.signature(ESTIMATOR.find(name, self.folder)).parameters
        if setting not in known:
            raise InvalidConfig(str(UnknownName(f"setting of estimator {name} to be told", setting, known)))

    def _check_place(self, row: str, place: str) -> None:
        known = [*self.recordings, *(f"{body}/{name}" for body in self.embodiments for name in self.recordings)]
        if place not in known:
            raise InvalidConfig(f"row '{row}': {UnknownName('recording', place, known)}")

    def _probe(self, spec: Any) -> Any:
        return PROBES[spec] if isinstance(spec, str) and spec in PROBES else spec


def _seeds(given: Any) -> tuple[int, ...]:
    if isinstance(given, Sequence) and not isinstance(given, str):
        found = tuple(whole("seeds", one, least=0) for one in given)
        if not found or len(set(found)) != len(found):
            refuse("seeds", given, "whole numbers of at least 0, none twice")
        return found
    return tuple(range(whole("seeds", given, least=1, most=_MOST_SEEDS)))


def _first_maps(given: Any) -> Any:
    if isinstance(given, Mapping):
        return {str(seed): whole(f"first_maps.{seed}", count, least=1) for seed, count in given.items()}
    return whole("first_maps", given, least=1)


def _map_settings(given: Any) -> Table:
    if not isinstance(given, Mapping):
        refuse("maps", given, "a table of settings")
    known = [name for name in inspect.signature(BodyImage.learn).parameters if name not in _GIVEN_BY_US]
    specs.refuse_unknown("setting of maps", given, known)
    return {name: specs.written(f"maps: {name}", value) for name, value in given.items()}


def _mapping(what: str, given: Any, name: Callable[[Any], str] | None = None) -> dict[str, Any]:
    """Name -> spec, of a list by names of their own."""
    if isinstance(given, list | tuple) and name is not None and given:
        found: dict[str, Any] = {}
        for spec in given:
            own = name(spec)
            found[own if own not in found else f"{own}_{len(found)}"] = spec
        given = found
    if not isinstance(given, Mapping) or not given:
        raise InvalidConfig(f"{what}: give at least one, NAME -> spec")
    return {specs.plain_name(what.removesuffix("s"), key): spec for key, spec in given.items()}


def _named_bodies(given: Any) -> dict[str, Any]:
    if isinstance(given, Mapping):
        return _mapping("embodiments", given)
    if isinstance(given, Embodiment):
        return _mapping("embodiments", {re.sub(r"[^\w.-]", "_", given.name): given})
    if given is None:
        return {"unknown": None}
    if not isinstance(given, str | Path):
        refuse("embodiments", given, "an embodiment, its name, the path of a TOML file, or NAME -> such")
    return _mapping("embodiments", {Path(given).stem: given})


def _row_name(spec: Any) -> str:
    estimator = spec.estimator if isinstance(spec, Row) else spec
    if estimator is None:
        return "direct"
    if isinstance(estimator, str | type | Mapping):
        return specs.snake(ESTIMATOR.parts(estimator)[0].rpartition(":")[2].rpartition(".")[2])
    return specs.snake(type(estimator).__name__)


def _probe_key(spec: Any) -> str:
    return spec if isinstance(spec, str) and spec in PROBES else probe_name(built_probe(spec))


def _is_path(given: Any) -> bool:
    return isinstance(given, Path) or (isinstance(given, str) and given.endswith(".nc"))


def _is_hash(given: Any) -> bool:
    return isinstance(given, str) and re.fullmatch(r"[0-9a-f]{64}", given) is not None


def _with_paths(value: Any, names: Mapping[str, str]) -> Any:
    """A table in which hashes of what was handed over are the names of its files."""
    if isinstance(value, Mapping):
        if list(value)[:1] == ["given"] and value["given"] in names:
            return {"embodiment": names[value["given"]], **{k: v for k, v in value.items() if k != "given"}}
        return {key: _with_paths(item, names) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_paths(item, names) for item in value]
    return names.get(value, value) if isinstance(value, str) else value
