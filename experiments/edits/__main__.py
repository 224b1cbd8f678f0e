"""Do edits arrive, keep the style and the feet, and how fast? python -m experiments.edits --clips FOLDER"""

from __future__ import annotations

import argparse
import platform
from collections.abc import Sequence
from pathlib import Path

import torch

from experiments.bench.__main__ import processor
from experiments.edits.cases import clips
from experiments.edits.measure import arrivals, qualities, timings
from experiments.report import integers, markdown
from hopdiff.editing.root_path import root_path
from hopdiff.io.files import write_whole

HERE = Path(__file__).parent


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.edits", description=__doc__)
    parser.add_argument("--clips", type=Path, help="folder of BVH files; without it a run of our own")
    parser.add_argument("--frames", type=integers, default=[100, 316, 450, 2798, 10_000, 100_000], help="to be timed")
    parser.add_argument("--rounds", type=int, default=7, help="timings of each kind, in turns; the median counts")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md")
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    found = clips(given.clips)
    paths = {name: (root_path(clip), clip.frame_time) for name, clip in found.items()}
    timed = "walk_straight_cmu_07_01" if "walk_straight_cmu_07_01" in paths else next(iter(paths))
    text = "\n".join(
        (
            f"{processor()}, 1 thread, torch {torch.__version__}, Python {platform.python_version()}; clips:"
            f" {', '.join(found)}.",
            "",
            "## Arrival",
            "",
            "Turns of -90 to 180 degrees by 45, each at the same place, 30 % of the way aside and 10 % ahead.",
            "",
            markdown(
                (
                    "alpha",
                    "edits",
                    "arrive",
                    "rounds (median)",
                    "most",
                    "place off mm",
                    "yaw off deg",
                    "start moved mm",
                ),
                arrivals(paths),
            ),
            "## Style and feet",
            "",
            "Stretch: length of the way after over before. Side-slip: 95th percentile of the change of the angle"
            " between way and facing. Turn: largest in 1/30 s. Feet: mean speed of standing points, and how far one"
            " gets within a contact, in the source / after the edit / after the clean-up; depth under the floor in the"
            " source / after the clean-up. Joints: fastest turn of any, against the source's.",
            "",
            markdown(
                (
                    "clip",
                    "edit",
                    "stretch",
                    "side-slip deg",
                    "turn deg",
                    "slide m/s",
                    "drift cm",
                    "depth mm",
                    "joints x",
                ),
                qualities(found),
            ),
            "## Time",
            "",
            f"Position and 90 degrees, set-up included, on {timed} repeated; beside a dense pseudo-inverse.",
            "",
            markdown(
                ("frames", "ours ms", "dense ms", "dense / ours"), timings(*paths[timed], given.frames, given.rounds)
            ),
        )
    )
    write_whole(given.out / "results.md", text)
    print(text)


if __name__ == "__main__":
    main()
