"""What each ambiguity of Fuke, Ogino and Asada (2007) is worth: every reading run, all else as in the library.

    python comparisons/ambiguities/run.py               # writes results.json, table.md and the figure beside this file
    python comparisons/ambiguities/run.py --redraw      # table and figure again, from the results that are there

With ``--store`` an interrupted run is taken up where it ended. The infant touches its face for 200 s. Kinematic
recordings train the network for 200 steps, those with dynamics and torque noise for 500, as the paper has it.
`docs/ambiguities.md` says what the paper leaves open and what we chose.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from contextlib import nullcontext
from pathlib import Path

import figure

from bodyimage_kin import figures
from bodyimage_kin.published import ambiguities
from bodyimage_kin.study.statistics import PUBLISHED

HERE = Path(__file__).parent


def main() -> None:
    """Computes what is missing, and writes everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=PUBLISHED, help="recordings of each motion (default: 30)")
    parser.add_argument("--duration", type=float, default=200.0, help="of touching [s] (default: 200)")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: one a core)")
    parser.add_argument("--store", type=Path, default=None, help="folder that keeps what is done (default: none)")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the results")
    parser.add_argument("--redraw", action="store_true", help="only summarise and draw the results of that folder")
    asked = parser.parse_args()
    if asked.redraw:
        found = json.loads((asked.out / "results.json").read_text(encoding="utf-8"))
        found["summary"] = ambiguities.summarise(found["values"], found["measures"])
    else:
        study = ambiguities.grid(asked.seeds, asked.duration)
        with nullcontext(asked.store) if asked.store else tempfile.TemporaryDirectory() as store:
            results = study.run(store, workers=asked.workers, progress=True)
        command = f"python comparisons/ambiguities/run.py --seeds {asked.seeds} --duration {asked.duration:g}"
        found = {"command": command, **ambiguities.judge(results)}
    ambiguities.write_summary(found, asked.out)
    figures.save(figure.draw(found["summary"]), asked.out, "figure")


if __name__ == "__main__":
    main()
