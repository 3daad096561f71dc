"""What of a NAO's touches is trusted, and the body that they tell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import robot as nao
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.body.clusters import touched_place
from bodyimage_kin.calibration import Calibrated, Observed, calibrate

BLOCKS = 20


def free(by: str) -> dict[str, tuple[str, ...]]:
    """What is fitted: name -> groups of measures."""
    what = "finger" if by == "finger" else "arm's skin"
    return {
        "as it is drawn": (),
        what: ("hand",),
        f"{what}, mount": ("hand", "skin"),
        f"{what}, mount, zeros": ("hand", "skin", "offsets"),
        "all of the arm": ("hand", "skin", "offsets", "axes"),
    }


@dataclass(frozen=True, eq=False)
class Found:
    """What the touches of one recording tell of the body.

    Attributes:
        what: That recording.
        told: How many touches there are of which kind, and the held-out error of each fit [mm].
        fit: The chosen one.
        body: Its body, seen by the eye behind its own skin.
        drawn: The body as it is drawn, seen by the same eye.
        touches: Those that are mapped; their ``hand_offset``, if any, is that of the body that was found.
        drawn_offset: (1, touches, 3) the same of the drawn body [m].
    """

    what: nao.Touched
    told: dict[str, Any]
    fit: Calibrated
    body: bk.Embodiment
    drawn: bk.Embodiment
    touches: xr.Dataset
    drawn_offset: np.ndarray | None


def unstuck(every: xr.Dataset) -> xr.Dataset:
    """The touches in postures that come back thrice at most: in others a taxel stays on."""
    _, same, times = np.unique(every["q"].values[0].round(3), axis=0, return_inverse=True, return_counts=True)
    return every.isel(time=np.flatnonzero(times[same.ravel()] <= 3))


def trusted(drawn: bk.Embodiment, every: xr.Dataset) -> tuple[xr.Dataset, dict[str, int]]:
    """The touches without those of a stuck taxel or a hand that is elsewhere, and how many these are.

    Once the hand is fitted, robustly and on every second block, a touch counts as elsewhere beyond the median
    distance and five robust standard deviations.
    """
    left = unstuck(every)
    even = np.flatnonzero(left["block"].values[0] % 2 == 0)
    fit = calibrate(drawn, Observed(left.isel(time=even), use=["touches"]), free=["hand"], folds=2)
    skin = fit.body.require_skin()
    offset = fit.hand_offset(left["hand_offset"].values[0]) if "hand_offset" in left else None
    tips = fit.body.hand_in_skin(left["q"].values[0], offset).numpy()
    places = [touched_place(skin.link_positions, active) for active in left["touched"].values[0]]
    away = np.array(
        [
            np.nan if at is None else np.linalg.norm(tip - skin.link_positions[at].mean(0))
            for tip, at in zip(tips, places, strict=True)
        ]
    )
    middle = np.nanmedian(away)
    far = away > middle + 5 * 1.4826 * np.nanmedian(np.abs(away - middle))
    counts = {"touches": every.sizes["time"], "stuck": int(every.sizes["time"] - left.sizes["time"])}
    counts |= {"elsewhere": int(far.sum())}
    return left.isel(time=np.flatnonzero(~far)), counts


def found(what: nao.Touched, data: Path, quick: bool) -> Found:
    """What is found of the body on every second block, and the touches of the others."""
    drawn = nao.nominal(what, data)
    every, counts = trusted(drawn, nao.touches(what, drawn, data, BLOCKS))
    odd = every["block"].values[0] % 2 == 1
    fitted, mapped = (every.isel(time=np.flatnonzero(rows)) for rows in (~odd, odd))
    # Five folds of contiguous blocks suffice.
    fitted = fitted.assign(block=fitted["block"] // 4)
    errors, chosen = {}, None
    for name, groups in free(what.by).items():
        if quick and groups not in ((), ("hand", "skin")):
            continue
        fit = calibrate(drawn, Observed(fitted, use=["touches"]), free=groups or ["hand"])
        error = (fit.held_out if groups else fit.nominal).medians[0]
        errors[name] = {"numbers": fit.free if groups else 0, "held_out_mm": 1e3 * float(error)}
        if groups == ("hand", "skin"):
            chosen = fit
    assert chosen is not None
    told = {
        "touches": counts | {"calibrated": fitted.sizes["time"], "mapped": mapped.sizes["time"]},
        "calibration": errors,
    }
    offset = None
    if "hand_offset" in mapped:
        offset = mapped["hand_offset"].values
        mapped = mapped.assign(hand_offset=(mapped["hand_offset"].dims, chosen.hand_offset(offset)))
    eye = nao.eye(chosen.body.require_skin())
    return Found(what, told, chosen, nao.seen_by(chosen.body, eye), nao.seen_by(drawn, eye), mapped, offset)
