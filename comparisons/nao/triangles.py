"""Whether the triangles of a NAO's skins are where they are published: ``run.py --triangles``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import robot as nao
from fitting import BLOCKS, unstuck
from scipy.spatial.transform import Rotation

from bodyimage_kin import metrics
from bodyimage_kin.body.clusters import touched_place
from bodyimage_kin.calibration import Observed, calibrate


def misplaced(what: nao.Touched, data: Path) -> dict[str, Any]:
    """What the touches say of each triangle, numbered as on the published skin, in mm and degrees.

    Touches from elsewhere are among them, for on a misplaced triangle every touch is. The finger alone is fitted,
    robustly, to the blocks of one parity, and foretells the touches of the other: the skin stays as it is drawn. A
    touch is of the triangle that has most of its taxels.
    """
    drawn = nao.nominal(what, data)
    every = unstuck(nao.touches(what, drawn, data, BLOCKS))
    skin = drawn.require_skin()
    odd = every["block"].values[0] % 2 == 1
    felt = np.full((every.sizes["time"], 3), np.nan)
    for half in (odd, ~odd):
        fitted = every.isel(time=np.flatnonzero(~half))
        fit = calibrate(drawn, Observed(fitted, use=["touches"]), free=["hand"], folds=2)
        felt[half] = fit.body.hand_in_skin(every["q"].values[0][half]).numpy()
    places, units = np.full_like(felt, np.nan), np.full(len(felt), -1)
    for row, active in enumerate(every["touched"].values[0]):
        at = touched_place(skin.link_positions, active)
        if at is not None:
            places[row] = skin.link_positions[at].mean(0)
            units[row] = np.bincount(skin.units[at]).argmax()
    found = metrics.misplaced_units(felt, places, units)
    return {
        "touches": int((units >= 0).sum()),
        "tested": int(np.isfinite(found.p_moved).sum()),
        "scale": found.scale,
        "scatter_mm": 1e3 * float(np.median(found.scatter[np.isfinite(found.p_moved)])),
        "largest_mm": 1e3 * float(np.nanmax(np.linalg.norm(found.displacement, axis=1))),
        "warp_mm": 1e3 * found.warp,
        "turn_warp_degrees": float(np.degrees(found.turn_warp)),
        "misplaced": found.misplaced.tolist(),
        "felt_in_place_of": {str(unit): place for unit, place in found.places.items()},
        "found_if": _power(felt, places, units, found),
        "triangles": {
            str(unit): {
                "touches": int(found.touches[row]),
                "off_mm": 1e3 * float(np.linalg.norm(found.displacement[row])),
                "spread_mm": 1e3 * float(found.spread[row]),
                "scatter_mm": 1e3 * float(found.scatter[row]),
                "turn_degrees": float(np.degrees(found.turn[row])),
                "turn_spread_degrees": float(np.degrees(found.turn_spread[row])),
                "p_moved": float(found.p_moved[row]),
                "p_turned": float(found.p_turned[row]),
            }
            for row, unit in enumerate(found.units)
            if np.isfinite(found.p_moved[row])
        },
    }


def _power(felt: np.ndarray, places: np.ndarray, units: np.ndarray, found: metrics.MisplacedUnits) -> dict[str, float]:
    """Share of tested triangles that these touches would find if the table of places were wrong about them.

    Each at a time: moved by 10 mm towards its nearest neighbour, swapped with it, or turned by 120 degrees.
    """
    names = found.units[np.isfinite(found.p_moved)]
    middles = np.stack([places[units == unit].mean(0) for unit in names])
    away = np.linalg.norm(middles[:, None] - middles, axis=-1)
    nearest = (away + np.diag(np.full(len(names), np.inf))).argmin(1)
    hits: dict[str, list[bool]] = {"moved_10_mm": [], "swapped": [], "turned_120_degrees": []}
    for one, (unit, other) in enumerate(zip(names, nearest, strict=True)):
        here, there, across = units == unit, units == names[other], middles[other] - middles[one]
        altered = {kind: places.copy() for kind in hits}
        altered["moved_10_mm"][here] += 0.01 * across / np.linalg.norm(across)
        altered["swapped"][here] += across
        altered["swapped"][there] -= across
        local = places[here] - middles[one]
        normal = np.linalg.svd(local, full_matrices=False)[2][2]
        turn = Rotation.from_rotvec(2 * np.pi / 3 * normal).as_matrix()
        altered["turned_120_degrees"][here] = local @ turn.T + middles[one]
        for kind, wrong in altered.items():
            hits[kind].append(unit in metrics.misplaced_units(felt, wrong, units, resamples=200).misplaced)
    return {kind: float(np.mean(hit)) for kind, hit in hits.items()}


def table(found: dict[str, Any]) -> str:
    """A row a triangle."""
    head = ["triangle", "touches", "off [mm]", "scatter of its touches [mm]", "turned [degrees]", "p moved", "p turned"]
    rows = [head, ["---"] + ["---:"] * 6]
    for name, one in found["triangles"].items():
        off = f"{one['off_mm']:.1f} ± {one['spread_mm']:.1f}"
        turn = f"{one['turn_degrees']:.0f} ± {one['turn_spread_degrees']:.0f}"
        p = (f"{one[key]:.2g}" for key in ("p_moved", "p_turned"))
        rows.append([name, str(one["touches"]), off, f"{one['scatter_mm']:.1f}", turn, *p])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)
