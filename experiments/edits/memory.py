"""How much memory an edit takes, in a process of its own: python -m experiments.edits.memory FRAMES [FILE]"""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import torch

from experiments.edits.cases import clips
from experiments.edits.measure import whole
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import read_bvh


def peak(frames: int, file: Path | None) -> float:
    """Megabytes that an edit of so many frames takes beyond what is there before it. file: None for a run of ours."""
    words = [sys.executable, "-m", "experiments.edits.memory", str(frames), *([] if file is None else [str(file)])]
    return float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


def _resident() -> float:
    """Largest so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _taken(clip: Clip, frames: int) -> float:
    whole(clip, min(frames, 300))  # what is loaded once counts for nothing
    before = _resident()
    whole(clip, frames)
    return _resident() - before


if __name__ == "__main__":
    torch.set_num_threads(1)
    given = read_bvh(sys.argv[2]).clip() if len(sys.argv) > 2 else next(iter(clips(None).values()))
    print(_taken(given, int(sys.argv[1])))
