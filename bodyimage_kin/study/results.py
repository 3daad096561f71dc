"""What a store holds of a study, as one dataset."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import xarray as xr

from bodyimage_kin.recordings.schema import versions
from bodyimage_kin.study import cells, store
from bodyimage_kin.study.store import Store

if TYPE_CHECKING:
    from bodyimage_kin.study.study import Study

MISSING = "not computed yet"
"""The failure of a cell that nobody has worked on."""


def attributes(origin: Mapping[str, Any]) -> dict[str, str]:
    """The origin of a result, and the versions of what computed it, as NetCDF keeps them: JSON strings."""
    return {
        "config": json.dumps(origin["config"]),
        "urdf_sha256": json.dumps(origin["urdf_sha256"]),
        "embodiment_sha256": json.dumps(origin["embodiment_sha256"]),
        "skin_shape": json.dumps(origin["skin_shape"]),
        "seeds": json.dumps(origin["config"]["seeds"]),
        "versions": json.dumps(versions()),
    }


def gather(study: Study, place: Store, origin: Mapping[str, Any]) -> xr.Dataset:
    """Every cell as one dataset; see :meth:`bodyimage_kin.Study.gather`."""
    grid: dict[tuple[str, str], list[xr.Dataset]] = {}
    facts: dict[tuple[str, str], list[xr.Dataset]] = {}
    used = {json.dumps(versions())}
    for block, ground in study.grounds(origin):
        key = ground.embodiment, ground.recording
        row = []
        for name in study.estimators:
            path = place.cell(ground, block, name)
            row.append(store.read(path) if path.exists() else cells.failed(ground, study.metrics, MISSING))
            used |= {row[-1].attrs["versions"]} if row[-1].attrs else set()
        names = cells.labels("estimator", list(study.estimators))
        grid.setdefault(key, []).append(cells.concat(row, names))
        path = place.scene(ground, block)
        if path.exists():
            facts.setdefault(key, []).append(_summary(store.read(path), study.per_posture))
    scores = _over_recordings(study, {key: cells.concat(blocks, "seed") for key, blocks in grid.items()})
    if facts:
        known = _over_recordings(study, {key: cells.concat(blocks, "seed") for key, blocks in facts.items()})
        scores = xr.merge([scores, known.reindex(seed=scores["seed"])], join="outer", combine_attrs="override")
    found = scores.transpose("embodiment", "recording", "estimator", "seed", "probe", ...)
    return found.assign_attrs(attributes(origin), all_versions=json.dumps([json.loads(one) for one in sorted(used)]))


def _over_recordings(study: Study, grid: Mapping[tuple[str, str], xr.Dataset]) -> xr.Dataset:
    return cells.concat(
        [
            cells.concat(
                [grid[embodiment, name] for name in study.recordings if (embodiment, name) in grid],
                cells.labels("recording", [name for name in study.recordings if (embodiment, name) in grid]),
            )
            for embodiment in study.embodiments
            if any(key[0] == embodiment for key in grid)
        ],
        cells.labels("embodiment", [one for one in study.embodiments if any(key[0] == one for key in grid)]),
    )


def _summary(facts: xr.Dataset, per_posture: bool) -> xr.Dataset:
    """Of a scene's facts, those that a result keeps."""
    away = facts[["mahalanobis_distance", "hand_distance"]]
    of_maps = [name for name in facts if str(name).startswith("direct_map_")]
    kept = facts[["excitation", "max_oracle_difference", *of_maps]].merge(away.mean("posture", keep_attrs=True))
    by_posture = away.rename({str(name): f"{name}_by_posture" for name in away.data_vars})
    return kept.merge(by_posture) if per_posture else kept.drop_dims("posture", errors="ignore")
