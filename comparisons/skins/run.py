"""What the published tables of skins hold: ``python comparisons/skins/run.py --data FOLDER``, a table beside this file.

FOLDER has ``icub_skin/``, the text files of ``app/skinGui/conf/positions`` of ``robotology/icub-main``, and ``nao/``
with the folder ``Transformations`` of the robot ``nao`` in ``ctu-vras/multirobot-calibration``, both on GitHub.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bodyimage_kin.body import TaxelTable, read_icub_taxels, read_nao_taxels

PATCHES = {
    "head": ((*range(9), 12, 13, 15), (*range(16, 25), 28, 29, 31)),
    "torso": ((*range(6), *range(8, 16)), (16, 17, 18, *range(24, 32))),
    "leftArm": ((*range(16),), (*range(19, 24), 25, 26, 31)),
    "rightArm": ((*range(16),), (*range(19, 24), 25, 26, 31)),
}
"""The triangles that are mounted on each patch of a part of NAO, in the order of its file."""
_HEAD = ("table", "taxels", "pads", "dummies", "pieces of the graph", "spacing [mm]", "notes")


def tables(data: Path) -> dict[str, TaxelTable]:
    """Every table in the folder, by name."""
    icub = {f"iCub {file.stem}": read_icub_taxels(file) for file in sorted((data / "icub_skin").glob("*.txt"))}
    transformations = data / "nao" / "Transformations"
    return icub | {
        f"NAO {part}": read_nao_taxels(transformations / f"{part}.txt", patches) for part, patches in PATCHES.items()
    }


def table(data: Path) -> str:
    """The counts as a page."""
    rows = []
    for name, one in tables(data).items():
        skin = one.skin(one.name)
        notes = "; ".join(skin.notes) or "none"
        numbers = [*one.counts.values(), skin.pieces, f"{1000 * skin.spacing:.2f}"]
        rows.append(" | ".join([name, *map(str, numbers), notes]))
    lines = [" | ".join(_HEAD), " | ".join(["---"] + ["---:"] * 5 + ["---"]), *rows]
    return "".join(f"| {line} |\n" for line in lines)


def main() -> None:
    """Writes table.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of the tables")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the result")
    asked = parser.parse_args()
    if not (asked.data / "icub_skin").is_dir() or not (asked.data / "nao" / "Transformations").is_dir():
        parser.exit(
            0, f"skipped: {asked.data} has no icub_skin/ and nao/Transformations/; --help says where they are from\n"
        )
    (asked.out / "table.md").write_text(table(asked.data), encoding="utf-8")


if __name__ == "__main__":
    main()
