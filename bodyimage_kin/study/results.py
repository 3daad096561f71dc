"""What a store holds of a study, as one dataset; nothing that the store names is imported for it."""

from __future__ import annotations

import io
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin._files import write_bytes
from bodyimage_kin.errors import InvalidConfig, OutputRefused
from bodyimage_kin.recordings.schema import versions
from bodyimage_kin.study.blocks import blocks
from bodyimage_kin.study.kept import by_recording, cells_in, opened
from bodyimage_kin.study.parts import Part
from bodyimage_kin.study.scores import SCORES
from bodyimage_kin.study.store import Store

__all__ = ["MISSING", "attributes", "gather", "read_study", "recording_of", "write_results"]

MISSING = "not computed yet"
"""The failure of a cell that nobody has worked on."""
_GRID = ("embodiment", "recording", "estimator", "seed")


def read_study(folder: str | Path) -> xr.Dataset:
    """The results of the study in a folder, as :meth:`bodyimage_kin.Study.run` gives them.

    Cells that are missing count as failed. Nothing is written, and nothing that the study names is imported.

    Args:
        folder: A study's store.

    Raises:
        InvalidConfig: A folder without a study, or one that this version cannot read.
    """
    with opened(Path(folder)) as origin:
        return gather(Store(Path(folder).absolute()), origin)


def write_results(results: xr.Dataset, path: Path) -> None:
    """Writes results as NetCDF, atomically.

    Raises:
        OutputRefused: A place that cannot be written to.
    """
    with io.BytesIO() as file:
        # Not straight into the file: a disk that fills up would end the process within HDF5.
        results.to_netcdf(file, engine="h5netcdf")
        data = file.getvalue()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, data)
    except OSError as problem:
        raise OutputRefused(f"cannot write '{path}': {problem.strerror}; name another folder") from None


def recording_of(
    folder: str | Path, recording: str, seed: int, role: str = "training", embodiment: str = ""
) -> xr.Dataset:
    """A recording that a study made, or was handed.

    Args:
        folder: The study's store.
        recording: Its name in the study.
        seed: Of the study.
        role: ``"training"``, ``"use"`` or ``"tour"``.
        embodiment: Its name in the study; empty: the first.

    Raises:
        InvalidConfig: No study, or it has no such recording (yet).
    """
    place = Store(Path(folder).absolute())
    with opened(Path(folder)) as origin:
        for block in blocks(origin, place.folder):
            if block.recording == recording and seed in block.seeds and embodiment in ("", block.embodiment):
                kept = place.recordings(block)
                if kept is not None and role in kept[1]:
                    return kept[1][role][block.seeds.index(seed)].copy(deep=True)
    raise InvalidConfig(f"'{folder}' has no recording '{recording}' of seed {seed} and role '{role}'")


def attributes(origin: Mapping[str, Any]) -> dict[str, str]:
    """The origin of a result, and the versions of what computed it, as NetCDF keeps them: JSON strings."""
    hashes = ("urdf_sha256", "embodiment_sha256", "skin_shape")
    found = {"config": origin["config"], **{name: origin[name] for name in hashes}}
    return {name: json.dumps(value) for name, value in {**found, "seeds": origin["config"]["seeds"]}.items()}


def gather(place: Store, origin: Mapping[str, Any]) -> xr.Dataset:
    """Every cell as one dataset; see :meth:`bodyimage_kin.Study.run`."""
    config = origin["config"]
    axes = {"embodiment": list(config["embodiments"]), "recording": list(config["recordings"])}
    axes |= {"estimator": list(config["estimators"]), "seed": list(config["seeds"])}
    scores, facts = _Collected(axes, _GRID), _Collected(axes, ("embodiment", "recording", "seed"))
    failure = np.full([len(names) for names in axes.values()], "", dtype=object)
    used = {json.dumps(versions())}
    left_out: dict[str, dict[str, list[str]]] = {}
    alike: dict[str, Any] = {}

    def slim(part: Part) -> Part:
        """A part that shares what it says alike with others, so that of many cells only numbers are kept."""
        return Part({}, part.arrays, {name: alike.setdefault(json.dumps(one), one) for name, one in part.notes.items()})

    for ones in by_recording(blocks(origin, place.folder)):
        rows = [name for name, row in config["estimators"].items() if ones[0].is_on(row)]
        cells = cells_in(place.folder, ones, config["estimators"], slim, mend=place.mends)
        for block in ones if rows else ():
            seeds = slice(block.first, block.first + len(block.seeds))
            at = axes["embodiment"].index(block.embodiment), axes["recording"].index(block.recording)
            if (part := place.facts(block)) is not None:
                facts.add(slim(part), (*at, seeds), keep=part.notes["kept"])
            for name in rows:
                here = (*at, axes["estimator"].index(name), seeds)
                cell = cells.get((name, block.number))
                failure[here] = MISSING if cell is None else cell.notes["failures"]
                if cell is not None:
                    scores.add(cell, here)
                    used.add(json.dumps(cell.notes["versions"]))
                    for score, why in cell.notes["left_out"].items():
                        left_out.setdefault(score, {}).setdefault(why, []).append(f"{block.place}/{name}")
    scores.expect(config["scores"])
    for dim, names in facts.labels.items():
        scores.labels.setdefault(dim, names)
    ours, theirs = scores.sizes(), facts.sizes()
    length = {dim: max(ours.get(dim, 0), theirs.get(dim, 0)) for dim in (*ours, *theirs)}
    variables = {**scores.variables(length), **facts.variables(length), "failure": (_GRID, failure.astype(str))}
    coords = {**axes, "probe": list(config["probes"]), **facts.labels, **scores.labels}
    dims = {dim for one in variables.values() for dim in one[0]}
    found = xr.Dataset(variables, {dim: names for dim, names in coords.items() if dim in dims})
    all_versions = [json.loads(one) for one in sorted(used)]
    # Of several, those that computed the cells.
    newest = json.dumps(all_versions[-1] if len(all_versions) == 1 else versions())
    return found.assign_attrs(
        attributes(origin), versions=newest, all_versions=json.dumps(all_versions), left_out=json.dumps(left_out)
    )


class _Collected:
    """Arrays of many parts, put side by side once all are there."""

    def __init__(self, axes: Mapping[str, list[Any]], grid: tuple[str, ...]) -> None:
        self.axes, self.grid = axes, grid
        self.labels: dict[str, list[str]] = {}
        self.pieces: dict[str, list[tuple[Any, np.ndarray, Mapping[str, list[str]]]]] = {}
        self.kinds: dict[str, tuple[list[str], dict[str, str]]] = {}

    def add(self, part: Part, place: tuple[Any, ...], keep: Collection[str] | None = None) -> None:
        """Takes a part's arrays, all or those that are kept."""
        labels: Mapping[str, list[str]] = part.notes["labels"]
        for dim, ones in labels.items():
            known = self.labels.setdefault(dim, [])
            known += [one for one in ones if one not in known]
        for name, values in part.arrays.items():
            if keep is None or name in keep:
                dims, attrs = part.notes["variables"][name]
                self.kinds[name] = list(dims), dict(attrs)
                self.pieces.setdefault(name, []).append((place, values, labels))

    def expect(self, names: Any) -> None:
        """Names what must be in the result even if nothing of it was computed."""
        for name in names:
            if name in SCORES and name not in self.kinds:
                self.kinds[name] = (list(SCORES[name].dims), SCORES[name].attributes("m"))
                for dim, values in (SCORES[name].labels or {}).items():
                    self.labels.setdefault(dim, list(values))

    def sizes(self) -> dict[str, int]:
        """How long each of the parts' own dimensions must be, for the longest."""
        found: dict[str, int] = {}
        for name, (dims, _) in self.kinds.items():
            for n, dim in enumerate(dims):
                here = max((values.shape[1 + n] for _, values, _ in self.pieces.get(name, [])), default=0)
                found[dim] = len(self.labels[dim]) if dim in self.labels else max(here, found.get(dim, 0))
        return found

    def variables(self, length: Mapping[str, int]) -> dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]:
        """Name -> dimensions, values and attributes, each dimension of the given length."""
        found = {}
        for name, (dims, attrs) in self.kinds.items():
            pieces, sizes = self.pieces.get(name, []), [length[dim] for dim in dims]
            text = any(values.dtype.kind == "U" for _, values, _ in pieces)
            whole = np.full(
                [*(len(self.axes[dim]) for dim in self.grid), *sizes], "" if text else np.nan, object if text else float
            )
            for place, values, labels in pieces:
                at = [
                    [self.labels[dim].index(one) for one in labels[dim]] if dim in labels else list(range(size))
                    for dim, size in zip(dims, values.shape[1:], strict=True)
                ]
                straight = all(one == list(range(len(one))) for one in at)
                inner = [slice(len(one)) for one in at]
                # A view of the whole: seeds are a slice.
                seeds = whole[place]
                if straight:
                    seeds[(slice(None), *inner)] = values
                else:
                    seeds[np.ix_(range(len(values)), *at)] = values
            found[name] = ((*self.grid, *dims), whole.astype(str) if text else whole, attrs)
        return found
