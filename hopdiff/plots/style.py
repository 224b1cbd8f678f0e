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
_NAMED = 0.1  # of the time shown that a phase must last for its name to have room


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
    """Tint the stances of a plot over time in the colour of their leg and draw a line where each phase begins.

    names: writes the phases and how long they last above the plot; one too brief for its name goes without.
    """
    whole = phases[-1].end - phases[0].start if phases else 0.0
    for phase in phases:
        colour = SIDE_COLOURS[phase.side] if phase.kind == "stance" else GROUND
        if phase.kind == "stance":
            axes.axvspan(phase.start, phase.end, color=pale(colour, 0.86), linewidth=0, zorder=0)
        if phase.start > phases[0].start:
            axes.axvline(phase.start, color=pale(GROUND, 0.4), linewidth=0.8, zorder=0.5)
        if names and phase.end - phase.start >= _NAMED * whole:
            label = f"{phase.side} stance" if phase.kind == "stance" else "flight"
            axes.text(
                (phase.start + phase.end) / 2,
                1.03,
                f"{label}\n{phase.end - phase.start:.3f} s",
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=9,
                color=colour,
            )


def widened(low: float, high: float, least: float, margin: float = 0.06) -> tuple[float, float]:
    """Ends of an axis for values from low to high: some margin around them, and never less than a span of `least`.

    Small changes then look small. margin: at either end, a share of the span.
    """
    middle, span = 0.5 * (low + high), max(least, (1.0 + 2.0 * margin) * (high - low))
    return middle - 0.5 * span, middle + 0.5 * span
