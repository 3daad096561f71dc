"""What a worker does: record blocks of seeds, or let rows learn from them; both go into the store."""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.recordings import experience
from bodyimage_kin.recordings.schema import versions
from bodyimage_kin.study import random_streams
from bodyimage_kin.study.answers import WrongResult
from bodyimage_kin.study.blocks import Block
from bodyimage_kin.study.bodies import load_body
from bodyimage_kin.study.calls import Step
from bodyimage_kin.study.context import Context, Score, image_unit
from bodyimage_kin.study.facts import SHARED_MAPS
from bodyimage_kin.study.grid import ROLES, Row, row_of
from bodyimage_kin.study.parts import Part
from bodyimage_kin.study.scoring import built_probe, computed, need_maps, resolve
from bodyimage_kin.study.simulated import recordings_of, simulation_of
from bodyimage_kin.study.specs import ESTIMATOR, Table
from bodyimage_kin.study.store import Store, padded, said

__all__ = [
    "AGAIN",
    "LATER",
    "Job",
    "failed",
    "fit_all",
    "work_through",
]

AGAIN = "again"
"""What comes of a cell whose recordings were damaged and are to be made anew."""
LATER = "later"
"""What comes of a job that is left to somebody else, because those before it took long."""
_LONG = 1.0
"""Time after which no further job is begun [s]."""


@dataclass(frozen=True, eq=False)
class Job:
    """One thing to do.

    Attributes:
        block: Of seeds.
        name: Of the row that learns from it, in the study; empty: it is to be recorded.
        row: Table of that row.
    """

    block: Block
    name: str = ""
    row: Table = field(default_factory=dict)


def work_through(block: Block, jobs: Sequence[Job], twice: bool = False) -> Iterator[Step | list[tuple[str, float]]]:
    """Does jobs of one recording in one embodiment, one after the other; their cells share a file.

    Args:
        block: Of the first.
        jobs: All to record, or all to learn.
        twice: Whether learning is done twice, and a seed fails of which not the same comes.

    Yields:
        A step at the beginning of each job, and one before all is written; then what went wrong with each job that
        left nothing behind (or :data:`AGAIN`, :data:`LATER`), and the time that it took [s].

    Raises:
        OutputRefused: The store cannot be written to.
    """
    store, first = Store(Path(block.store), mends=True), time.perf_counter()
    cells: list[Part] = []
    told: list[tuple[str, float]] = []
    # Recordings get to the disk while the next ones are made.
    with ThreadPoolExecutor(1) as writer:
        writing: list[Future[None]] = []
        for job in jobs:
            if time.perf_counter() - first > _LONG and told:
                told.append((LATER, 0.0))
                continue
            yield Step(str(store.log(job.block, *filter(None, [job.name]))))
            begin, failure = time.perf_counter(), ""
            if not job.name:
                failure = _record(job.block, store, lambda *what: writing.append(writer.submit(*what)))
            elif (cell := _learn(job.block, job.name, job.row, twice)) is not None:
                cells.append(cell)
            else:
                failure = AGAIN
            told.append((failure, time.perf_counter() - begin))
        yield Step()
        if cells:
            store.write_cells(block, cells)
        for one in writing:
            one.result()
    yield told


def failed(block: Block, name: str, table: Table, failure: str) -> Part:
    """The scores of a cell of which nothing came."""
    failures = [failure] * len(block.seeds)
    return _part(block, block.identity(name, block.config(table)), [], [None] * len(block.seeds), failures)


def fit_all(spec: Any, experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> list[Any]:
    """What an estimator learns from experiences, one seed each; a user's own need not have ``fit_many``.

    Raises:
        WrongResult: ``fit_many`` gave more or fewer.
    """
    if not callable(getattr(spec, "fit_many", None)):
        return [spec.fit(exp, seed) for exp, seed in zip(experiences, seeds, strict=True)]
    learned = list(spec.fit_many(experiences, seeds))
    if len(learned) != len(seeds):
        raise WrongResult(f"fit_many returned {len(learned)} learned Jacobians for {len(seeds)} seeds")
    return learned


# Inner ---------------------------------------------------------------------------------------------------------------


def _record(block: Block, store: Store, write: Callable[..., None]) -> str:
    """Makes the recordings of a block and measures facts of them; says what went wrong, if anything did."""
    try:
        body = load_body(block)
        recordings = recordings_of(block, body)
        loaded = {
            role: [store.given_recording(one) if isinstance(one, str) else one for one in ones]
            for role, ones in recordings.items()
        }
        names = list(block.settings["facts"])
        if need_maps(block.settings["scores"], Path(block.folder)):
            names += [name for name in SHARED_MAPS if name not in names]
        facts = [resolve(name, Path(block.folder)) for name in names]
        found = [
            computed(_context(block, body, loaded, index, Row(), {}), facts) if facts else ({}, {})
            for index in range(len(block.seeds))
        ]
    except (Exception, SystemExit) as problem:
        return said(problem)
    part = _part(block, block.identity(), facts, found, seen=loaded["training"][0])
    part.notes["kept"] = [one.name for one in facts[: len(block.settings["facts"])]]
    write(store.write_recordings, block, part, recordings)
    return ""


def _learn(block: Block, name: str, table: Table, twice: bool = False) -> Part | None:
    """Lets a row learn from a block, seeds together, and scores what it learned; None: nothing to learn from.

    A seed that failed has no score, and its failure says why.
    """
    there = _recorded(block)
    if there is None:
        _recorded.cache_clear()
        return None
    facts, recordings = there
    asked = [resolve(score, Path(block.folder)) for score in block.settings["scores"]]
    failures = [""] * len(block.seeds)
    runs: list[list[Any]] = []
    for _ in range(2 if twice else 1):
        found: list[Any] = [None] * len(block.seeds)
        with _state_kept():
            try:
                contexts = _taught(block, name, table, recordings, facts)
            except (Exception, SystemExit) as problem:
                failures = [said(problem)] * len(block.seeds)
            for index, failure in enumerate(failures):
                if not failure:
                    try:
                        found[index] = computed(contexts[index], asked)
                    except (Exception, SystemExit) as problem:
                        failures[index] = said(problem)
        runs.append(found)
    for index in range(len(block.seeds)):
        if not failures[index] and not _same(runs[0][index], runs[-1][index]):
            failures[index] = "NotDeterministic: the same experience and seed led to other scores the second time"
        if failures[index]:
            runs[0][index] = None
    seen = recordings["training"][0]
    return _part(block, block.identity(name, block.config(table)), asked, runs[0], failures, seen)


# The rows of a block come one after the other.
@lru_cache(maxsize=2)
def _recorded(block: Block) -> tuple[Part, dict[str, list[xr.Dataset]]] | None:
    return Store(Path(block.store), mends=True).recordings(block)


@contextmanager
def _state_kept() -> Iterator[None]:
    """What estimators may change for all of a process is afterwards as it was."""
    folder, dtype, threads, gradients = (
        Path.cwd(),
        torch.get_default_dtype(),
        torch.get_num_threads(),
        torch.is_grad_enabled(),
    )
    out, error = sys.stdout, sys.stderr
    try:
        with np.errstate(), warnings.catch_warnings():
            yield
    finally:
        os.chdir(folder)
        torch.set_default_dtype(dtype)
        torch.set_num_threads(threads)
        torch.set_grad_enabled(gradients)
        sys.stdout, sys.stderr = out, error


def _same(one: Any, other: Any) -> bool:
    """Whether scores of one seed are the same to the bit; what is measured aside."""
    names = set(one[0]) - {"fit_seconds"}
    return all(one[0][name].tobytes() == other[0][name].tobytes() for name in names)


def _context(
    block: Block,
    body: Embodiment | None,
    recordings: Mapping[str, Sequence[xr.Dataset]],
    index: int,
    row: Row,
    known: Mapping[str, Any],
) -> Context:
    """What the scores of one seed are functions of; on copies of its recordings, which nobody else sees changed."""
    settings, seed, folder = block.settings, block.seeds[index], Path(block.folder)
    count = settings["first_maps"] if row.first_maps is None else row.first_maps
    count = int(count.get(str(seed), 1)) if isinstance(count, Mapping) else int(count)
    with_maps = need_maps(settings["scores"], folder)
    seen, use, tour = (recordings[role][index].copy(deep=True) if role in recordings else None for role in ROLES)
    assert seen is not None
    return Context(
        body,
        seen,
        use,
        tour,
        probes={name: built_probe(table, folder) for name, table in settings["probes"].items()},
        row=row,
        simulation=simulation_of(block),
        map_seeds=random_streams.of_maps(block, seed, 1 + count) if with_maps else (),
        map_settings=settings["maps"],
        cut=settings["excitation_cut"],
        of=settings["metric_of"],
        known=known,
    )


def _taught(
    block: Block, name: str, table: Table, recordings: Mapping[str, Sequence[xr.Dataset]], facts: Part
) -> list[Context]:
    """A context a seed, with what the row's estimator learned from it."""
    body = load_body(block)
    folder, count = Path(block.folder), range(len(block.seeds))
    row = row_of(table, folder)
    known = [{key: values[index].copy() for key, values in facts.arrays.items()} for index in count]
    contexts = [_context(block, body, recordings, index, row, known[index]) for index in count]
    if row.estimator is None:
        return contexts
    begin = time.thread_time()
    seeds = [random_streams.of_a_fit(block, seed, row.stream or name) for seed in block.seeds]
    experiences = [experience(context.seen.copy(deep=True)) for context in contexts]
    told = [{key: _told(context, fact, folder) for key, fact in row.told.items()} for context in contexts]
    if row.told:
        specs = [ESTIMATOR.build(row.estimator, folder, body, one) for one in told]
        learned = [spec.fit(exp, seed) for spec, exp, seed in zip(specs, experiences, seeds, strict=True)]
    else:
        specs = [ESTIMATOR.build(row.estimator, folder, body)] * len(seeds)
        learned = fit_all(specs[0], experiences, seeds)
    if any(one is None for one in learned):
        raise WrongResult("fit returned nothing; it must return a learned Jacobian")
    seconds = (time.thread_time() - begin) / len(seeds)
    for context, one, spec, seed in zip(contexts, learned, specs, seeds, strict=True):
        context.learned, context.estimator, context.seed, context.seconds = one, spec, seed, seconds
    return contexts


def _told(context: Context, fact: str, folder: Path) -> Any:
    """A fact as a setting: a number, or an array."""
    value = context.known[fact] if fact in context.known else resolve(fact, folder).of(context)
    return float(value) if np.ndim(value) == 0 else np.asarray(value)


def _part(
    block: Block,
    identity: Table,
    asked: Sequence[Score],
    found: Sequence[tuple[dict[str, Any], dict[str, str]] | None],
    failures: Sequence[str] = (),
    seen: xr.Dataset | None = None,
) -> Part:
    """What was found of each seed, as a file holds it; ``seen``, one that was learned from, says what images are."""
    arrays, variables, labels = {}, {}, {"probe": list(block.settings["probes"])}
    if seen is not None and "axis" in seen.coords:
        labels["axis"] = [str(one) for one in seen["axis"].values]
    for score in asked:
        values = [one[0].get(score.name) if one is not None else None for one in found]
        if any(value is not None for value in values):
            arrays[score.name] = padded(values)
            variables[score.name] = [list(score.dims), score.attributes(image_unit(seen))]
            labels |= {dim: list(map(str, names)) for dim, names in (score.labels or {}).items()}
    lacking = {key: why for one in found if one is not None for key, why in one[1].items()}
    notes = {"variables": variables, "labels": labels, "left_out": lacking, "versions": versions()}
    return Part(identity, arrays, notes | {"failures": list(failures)})
