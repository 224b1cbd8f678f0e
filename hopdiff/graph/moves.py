"""The moves that a search makes: short stretches of the clips and transitions, seen from the body that makes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hopdiff.graph.blend import eased
from hopdiff.graph.graph import Complexes, Floats, Ints, MotionGraph

STRIDE = 1.0 / 6.0  # s between the frames at which a walk along a clip may be left
SAMPLES = 8  # of a move, at which places are checked
# How clips are bent: shares of the rate that is asked for, and of the way that is gone; short steps turn more tightly.
BENDS = ((1.0, 1.0), (-1.0, 1.0), (0.5, 1.0), (-0.5, 1.0), (1.0, 0.4), (-1.0, 0.4))
STANDING = 0.15  # m/s; slower is standing


@dataclass(frozen=True, eq=False)
class Moves:
    """All moves of a graph, those from one frame in a row.

    first: (N + 1,): the moves from frame f are first[f] to first[f + 1] - 1. end: (M,) frame that a move ends at.
    transition: (M,) the one that it takes, or -1 for a stretch of a clip. frames: (M,) that pass. turn: (M,) change of
    yaw [rad]. place: (M, S) complex, S places along the move in the frame of the body at its start: forward + i left
    [m]; the last one is where it ends. yaw: (M, S) there, seen from the start [rad]. passed: (M, S) frames until then.
    shown: (M, S) the frame of the graph that the body is in there, or nearest to in a blend. bend: (M,) turn that the
    clip is bent by, evenly along the move and contained in yaw and place [rad]. share: (M,) of the clip's own way that
    is gone.
    """

    graph: MotionGraph
    first: Ints
    end: Ints
    transition: Ints
    frames: Ints
    place: Complexes
    yaw: Floats
    passed: Ints
    shown: Ints
    bend: Floats
    share: Floats

    @cached_property
    def fastest(self) -> float:
        """Of all moves, metres of the straight line from a move's start to any place of it in a second [m/s]."""
        speed = np.abs(self.place) / (self.passed * self.graph.frame_time)
        return float(speed.max())

    @cached_property
    def quickest(self) -> float:
        """Of all moves, change of yaw until any place of it in a second [rad/s]."""
        return float((np.abs(self.yaw) / (self.passed * self.graph.frame_time)).max())

    @cached_property
    def farthest(self) -> float:
        """Largest distance of any place of a move from its start [m]."""
        return float(np.abs(self.place).max())


def stretches(graph: MotionGraph) -> tuple[int, Ints]:
    """Frames of a stretch, and for every frame (N,) the number of the stretch of a clip that it belongs to."""
    stride = max(1, round(STRIDE / graph.frame_time))
    frame = np.arange(graph.frames)
    start = graph.first[graph.clip_of(frame)]
    return stride, (frame - start) // stride + start


def moves_of(graph: MotionGraph) -> Moves:
    """From each frame on to the next stop, one in 1/6 s, and over every transition that begins before that."""
    stride, number = stretches(graph)
    frame = np.arange(graph.frames)
    clip = graph.clip_of(frame)
    begin = graph.first[clip]
    stop = np.minimum(begin + stride * (number - begin + 1), graph.first[clip + 1] - 1)
    goes = stop > frame
    # The transitions that begin at frames f to stop[f] - 1.
    low, high = np.searchsorted(graph.sources, frame), np.searchsorted(graph.sources, np.maximum(stop, frame + 1))
    counts = high - low
    origin = np.repeat(frame, counts)
    offset = np.arange(len(origin)) - np.repeat(np.cumsum(counts) - counts, counts)
    taken = np.repeat(low, counts) + offset
    start = np.concatenate((frame[goes], origin))
    transition = np.concatenate((np.full(int(goes.sum()), -1), taken))
    order = np.argsort(start, kind="stable")
    start, transition = start[order], transition[order]
    first = np.searchsorted(start, np.arange(graph.frames + 1))
    jumps = transition >= 0
    leave = np.where(jumps, graph.sources[transition], stop[start]) if len(graph.sources) else stop[start]
    end = np.where(jumps, graph.arrivals()[transition], leave) if len(graph.sources) else leave
    length = leave - start + jumps * (graph.window - 1)
    passed = np.ceil(length[:, None] * np.arange(1, SAMPLES + 1) / SAMPLES).astype(np.int64)
    place, yaw, shown = _along(graph, start, transition, leave, passed)
    plain = np.zeros(len(end))
    return Moves(graph, first, end, transition, length, place, yaw, passed, shown, plain, plain + 1.0)


def bent(moves: Moves, rate: float) -> Moves:
    """These moves, and the stretches of the clips among them bent by up to a rate to both sides [rad/s]."""
    graph = moves.graph
    start = np.repeat(np.arange(graph.frames), np.diff(moves.first))
    whole, along = np.arange(len(start)), np.flatnonzero(moves.transition < 0)
    taken = np.concatenate([whole, *(along for _ in BENDS)])
    rates = np.concatenate([0.0 * whole, *(np.full(len(along), part * rate) for part, _ in BENDS)])
    share = np.concatenate([0.0 * whole + 1.0, *(np.full(len(along), less) for _, less in BENDS)])
    order = np.argsort(start[taken], kind="stable")
    taken, rates, share = taken[order], rates[order], share[order]
    passed = moves.passed[taken]
    turned = rates[:, None] * passed * graph.frame_time
    middle = turned - 0.5 * np.diff(turned, prepend=0.0)
    steps = np.diff(moves.place[taken], prepend=0.0)
    place = np.cumsum(share[:, None] * np.exp(1j * middle) * steps, axis=1)
    frames = moves.frames[taken]
    return Moves(
        graph,
        np.searchsorted(start[taken], np.arange(graph.frames + 1)),
        moves.end[taken],
        moves.transition[taken],
        frames,
        place,
        moves.yaw[taken] + turned,
        passed,
        moves.shown[taken],
        rates * frames * graph.frame_time,
        share,
    )


def _along(
    graph: MotionGraph, start: Ints, transition: Ints, leave: Ints, passed: Ints
) -> tuple[Complexes, Floats, Ints]:
    """Places, yaws and frames shown `passed` frames after the start of each move, blended as `assemble` does."""
    here = start[:, None] + passed
    place, yaw, shown = graph.ground[here], graph.yaw[here], here
    if (transition >= 0).any():
        k = np.maximum(transition, 0)[:, None]
        step = here - leave[:, None]
        blended = (transition >= 0)[:, None] & (step > 0)
        there = np.where(blended, graph.targets[k] + step, here)
        turn = graph.turns[k]
        share = np.where(blended, eased(np.clip(step / (graph.window - 1), 0.0, 1.0)), 0.0)
        place = place + share * (np.exp(1j * turn) * graph.ground[there] + graph.shifts[k] - place)
        # Yaws are unwrapped in each clip for itself: whole turns between the two mean nothing.
        other = graph.yaw[there] + turn - yaw
        yaw = yaw + share * (other - 2.0 * np.pi * np.round(other / (2.0 * np.pi)))
        shown = np.where(share < 0.5, here, there)
    facing = graph.yaw[start][:, None]
    return np.exp(-1j * facing) * (place - graph.ground[start][:, None]), yaw - facing, shown


def standing(graph: MotionGraph) -> NDArray[np.bool_]:
    """(N,) frames around which the root stays nearly where it is: slower than 0.15 m/s over a window."""
    reach = max(1, graph.window // 2)
    frame = np.arange(graph.frames)
    clip = graph.clip_of(frame)
    before, after = np.maximum(frame - reach, graph.first[clip]), np.minimum(frame + reach, graph.first[clip + 1] - 1)
    speed = np.abs(graph.ground[after] - graph.ground[before]) / (np.maximum(after - before, 1) * graph.frame_time)
    found: NDArray[np.bool_] = speed < STANDING
    return found
