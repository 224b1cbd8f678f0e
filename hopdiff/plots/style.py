"""What all pictures share: colours, the look of axes, shaded phases."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdiff.motion import Phase

# Okabe and Ito's colours: told apart with every common form of colour blindness.
LEFT = "#0072B2"
RIGHT = "#D55E00"
BODY = "#3B4252"
GROUND = "#8C92A0"
INK = "#2B2F38"
FAINT = "#E6E8EE"
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7A5195", "#3B4252")

SIDE_COLOURS = {"left": LEFT, "right": RIGHT, "middle": BODY}


def mix(colour: str, other: str, share: float) -> str:
    """A colour with `share` (0 to 1) of another one in it; both as "#rrggbb"."""
    pairs = zip(_channels(colour), _channels(other), strict=True)
    return "#" + "".join(f"{round((1 - share) * a + share * b):02X}" for a, b in pairs)


def pale(colour: str, share: float = 0.5) -> str:
    """A colour with a share of white in it."""
    return mix(colour, "#FFFFFF", share)


def _channels(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def new_figure(width: float, height: float, title: str = "", layout: str | None = "constrained") -> Figure:
    """A white figure; width and height in inches."""
    figure = Figure(figsize=(width, height), facecolor="white", layout=layout)  # type: ignore[arg-type]
    if title:
        figure.suptitle(title, fontsize=13, fontweight="bold", color=INK)
    return figure


def tidy(axes: Axes, grid: bool = True) -> Axes:
    """Open frame, light grid, small quiet labels."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GROUND)
    axes.tick_params(colors=INK, labelsize=9, width=0.8)
    axes.xaxis.label.set(fontsize=10, color=INK)
    axes.yaxis.label.set(fontsize=10, color=INK)
    axes.title.set(fontsize=11, color=INK)
    if grid:
        axes.grid(color=FAINT, linewidth=0.8)
        axes.set_axisbelow(True)
    return axes


def shade_phases(axes: Axes, phases: Sequence[Phase], names: bool = False) -> None:
    """Tint the stances of a plot over time in the colour of their leg; `names` writes the phases above the plot."""
    for phase in phases:
        if phase.kind == "stance":
            axes.axvspan(phase.start, phase.end, color=pale(SIDE_COLOURS[phase.side], 0.86), linewidth=0, zorder=0)
        if names:
            colour = SIDE_COLOURS[phase.side] if phase.kind == "stance" else GROUND
            label = f"{phase.side} stance" if phase.kind == "stance" else "flight"
            middle = (phase.start + phase.end) / 2
            place = axes.get_xaxis_transform()
            axes.text(middle, 1.03, label, transform=place, ha="center", va="bottom", fontsize=9, color=colour)
