"""Characters side by side, drawn from their vertices alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

COLUMNS = 10
VIEW = np.radians(35.0)  # from the front towards the left of the character


def sheet(path: Path, bodies: Sequence[tuple[str, NDArray[np.float64], NDArray[np.int64]]]) -> None:
    """A picture of vertices (V, 3) and edges (E, 2) by name, the ground as a line; nearer ones are darker."""
    rows = -(-len(bodies) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(1.5 * COLUMNS, 2.1 * rows), squeeze=False)
    for ax in axes.flat:
        ax.axis("off")
    across = np.array((np.cos(VIEW), 0.0, -np.sin(VIEW)))
    ahead = np.array((np.sin(VIEW), 0.0, np.cos(VIEW)))
    for ax, (name, points, edges) in zip(axes.flat, bodies, strict=False):
        x, depth = points @ across, points @ ahead
        far = depth[edges].mean(axis=1)
        order = np.argsort(far)
        shade = np.clip((far - far.min()) / max(float(np.ptp(far)), 1e-9), 0.0, 1.0)[order]
        lines = np.stack((x, points[:, 1]), axis=-1)[edges[order]]
        middle, half = float(np.median(x)), 0.62 * float(np.ptp(points[:, 1]))
        ax.add_collection(LineCollection(list(lines), linewidths=0.7, colors=plt.get_cmap("Blues")(0.35 + 0.6 * shade)))
        ax.axhline(0.0, color="#D55E00", linewidth=0.8)
        ax.set_xlim(middle - half, middle + half)
        ax.set_ylim(-0.1 * half, 1.9 * half)
        ax.set_aspect("equal")
        ax.set_title(name.replace("+", "\n+"), fontsize=5)
    figure.tight_layout(pad=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)
