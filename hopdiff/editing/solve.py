"""The least change of a root path that brings it to its targets (Kim & Lee 2021, eq. 10-15, repaired).

The change U of the steps minimises a weighted sum over left, ahead and turn of |L U|^2 + ridge |U|^2, L the Laplacian,
so that the steps keep their differences from their neighbours: the style. Targets bind the place and yaw of frames,
which are sums of all steps before, so their rows are those of the Jacobian of the sum and not, as in eq. 10, the rows
of single steps; these leave the search hunting for hundreds of rounds. Rounds are Gauss-Newton steps that ask for at
most alpha of what lacks (eq. 15).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.editing.laplacian import Banded, squared_bands
from hopdiff.editing.root_path import RootPath, path_of, steps_of

FRAME = 1.0 / 30.0  # s; the frame interval at which ridge means what it says
STANDING = 0.05  # of the mean speed: slower frames count as that fast
HALVINGS = 6
POLISHINGS = 25
POLISH = 1e-6  # m and rad that are left at the end, far below what a file shows


@dataclass(frozen=True)
class SolveSettings:
    """alpha: largest part of an error asked for in one round [m, rad]. epsilon: error at which rounds end [m, rad].

    side, ahead, turn: weights of a change of the steps to the left, ahead and of the turn. ridge: weight of the change
    itself against its Laplacian: changes spread over about ridge^(-1/4) frames of 1/30 s, and go with the speed.
    standing: how much dearer a turn is where the body stands. ends: weight of a change of the first and the last step
    (the constraints S of eq. 10 on the states v_1 and v_T). rounds: at most.
    """

    alpha: float = 1.0
    epsilon: float = 0.01
    side: float = 30.0
    ahead: float = 1.0
    turn: float = 0.002
    ridge: float = 1e-4
    standing: float = 50.0
    ends: float = 1.0
    rounds: int = 50


@dataclass(frozen=True, eq=False)
class Targets:
    """What B edits of one path ask for. frames: (M,) in rising order, 1 or more. place: (B, M, 2) [m]. yaw: (B, M)
    [rad]. has_place, has_yaw: (M,) which of them bind. start_place: (B, 2), start_yaw: (B,) of frame 0.

    turning: whether frames may turn at all; if not, yaws do not bind and one round is exact.
    """

    frames: Tensor
    place: Tensor
    yaw: Tensor
    has_place: Tensor
    has_yaw: Tensor
    start_place: Tensor
    start_yaw: Tensor
    turning: bool = True

    def error(self, path: RootPath) -> tuple[Tensor, Tensor]:
        """What lacks: of the places (B, M, 2) [m] and of the yaws (B, M) [rad]; 0 where nothing binds."""
        place = (self.place - path.place[:, self.frames]) * self.has_place[:, None]
        return place, (self.yaw - path.yaw[:, self.frames]) * self.has_yaw


@dataclass(frozen=True, eq=False)
class Solution:
    """path: B edited paths. steps: (B, T - 1, 3). rounds: (B,) until the error fell below epsilon, 0 if it was there.

    error_place, error_yaw: (B,) largest that is left [m, rad]. converged: (B,) whether it is below epsilon.
    """

    path: RootPath
    steps: Tensor
    rounds: Tensor
    error_place: Tensor
    error_yaw: Tensor
    converged: Tensor


class PathSolver:
    """Edits of one path (unbatched), all with the same matrices, which are factored once.

    frame_time: [s]. weights: (3,) of left, ahead and turn in place of those of the settings; edits can be
    differentiated with respect to them and to all targets.
    """

    def __init__(
        self, path: RootPath, frame_time: float, settings: SolveSettings, weights: Tensor | None = None
    ) -> None:
        self.source = path
        self.settings = settings
        self.steps = steps_of(path)
        count = len(self.steps)
        ridge = settings.ridge * (frame_time / FRAME) ** 4
        if weights is None:
            weights = torch.tensor((settings.side, settings.ahead, settings.turn), dtype=torch.float64)
        slow = ridge * self._slowness() ** 2
        straight, turning = squared_bands(count), squared_bands(count)
        straight[0] += slow
        turning[0] += ridge + settings.standing * slow
        for bands in (straight, turning):
            bands[0, [0, -1]] += settings.ends
        # The matrices of left and ahead differ by a factor.
        self.weights = weights
        self.straight, self.turning = Banded(straight), Banded(turning)

    def _slowness(self) -> Tensor:
        """(T - 1,) mean speed over speed of every step."""
        pace = self.steps[:, :2].norm(dim=-1)
        mean = pace.mean().clamp_min(1e-9)
        found: Tensor = mean / pace.clamp_min(STANDING * float(mean))
        return found

    def solve(self, targets: Targets, guess: Tensor | None = None) -> Solution:
        """The edited paths of B sets of targets. guess: steps (B, T - 1, 3) near the solution; one round at least is
        then taken, to change no more than is needed."""
        settings = self.settings
        batch = len(targets.place)
        change = self.steps.new_zeros(batch, *self.steps.shape) if guess is None else guess - self.steps
        path = path_of(self.steps + change, targets.start_place, targets.start_yaw)
        rounds = torch.zeros(batch, dtype=torch.long)
        place, yaw = targets.error(path)
        size = _size(place, yaw)
        # Without turns the places are linear in the steps.
        alpha = settings.alpha if targets.turning else math.inf
        for k in range(settings.rounds):
            open_ = size > settings.epsilon
            if guess is not None and k == 0:
                open_ = torch.ones_like(open_)
            if not bool(open_.any()):
                break
            change, path, place, yaw = self._round(targets, change, path, place, yaw, alpha, open_)
            rounds = rounds + open_
            size = _size(place, yaw)
        converged = size <= settings.epsilon
        for _ in range(POLISHINGS):
            open_ = converged & (size > POLISH)
            if not bool(open_.any()):
                break
            change, path, place, yaw = self._round(targets, change, path, place, yaw, math.inf, open_, further=True)
            size = _size(place, yaw)
        return Solution(
            path,
            self.steps + change,
            rounds,
            place.norm(dim=-1).amax(-1),
            yaw.abs().amax(-1),
            converged,
        )

    def _round(
        self,
        targets: Targets,
        change: Tensor,
        path: RootPath,
        place: Tensor,
        yaw: Tensor,
        alpha: float,
        open_: Tensor,
        further: bool = False,
    ) -> tuple[Tensor, RootPath, Tensor, Tensor]:
        """One step of the open ones of the batch: the change, its path and what that lacks.

        First the least change of all that would meet the constraints if they were linear. Where that does not bring
        the error down by half of what was asked for, since turns move everything after them, the least further change
        is taken instead, halved until the error falls. further: takes that at once, as it ends in fewer steps.
        """
        wanted = torch.cat(
            (
                (place * _share(place.norm(dim=-1), alpha).unsqueeze(-1))[:, targets.has_place].flatten(1),
                (yaw * _share(yaw.abs(), alpha))[:, targets.has_yaw],
            ),
            dim=-1,
        )
        rows = jacobian(targets, path)
        spread = self._spread(rows)
        gram = torch.einsum("brnd,bsnd->brs", rows, spread)
        moved = torch.einsum("brnd,bnd->br", rows, change)
        factors = torch.linalg.solve(gram, torch.stack((wanted + moved, wanted), dim=-1))
        least, more = torch.einsum("brk,brnd->kbnd", factors, spread)
        size = _size(place, yaw)
        asked = torch.clamp(alpha / size, max=1.0)
        tried = torch.where(open_[:, None, None], change + more if further else least, change)
        length = torch.full_like(size, 0.5 if further else 1.0)
        enough = size if further else (1.0 - 0.5 * asked) * size
        for halving in range(HALVINGS + 1):
            ahead = path_of(self.steps + tried, targets.start_place, targets.start_yaw)
            lack = targets.error(ahead)
            bad = (_size(*lack) > enough) & open_
            if halving == HALVINGS or not bool(bad.any()):
                break
            tried = torch.where(bad[:, None, None], change + length[:, None, None] * more, tried)
            length = torch.where(bad, 0.5 * length, length)
            enough = size
        return tried, ahead, *lack

    def _spread(self, rows: Tensor) -> Tensor:
        """Rows (B, R, N, 3) through the inverses of the matrices."""
        batch, count, steps, _ = rows.shape
        right = rows.permute(3, 2, 0, 1).reshape(3, steps, batch * count)
        straight = self.straight.solve(torch.cat((right[0], right[1]), dim=-1)).chunk(2, dim=-1)
        solved = torch.stack((*straight, self.turning.solve(right[2])))
        return (solved / self.weights[:, None, None]).reshape(3, steps, batch, count).permute(2, 3, 1, 0)


def jacobian(targets: Targets, path: RootPath) -> Tensor:
    """(B, R, T - 1, 3) by how much what binds changes with each step: x and z of each place in turn, then the yaws.

    A step moves everything after it along itself; a turn turns everything after it about the place where it happens.
    """
    count = path.frames - 1
    before = torch.arange(1, count + 1) <= targets.frames[:, None]  # (M, N)
    c, s = torch.cos(path.yaw[:, :-1]), torch.sin(path.yaw[:, :-1])
    rows = []
    if bool(targets.has_place.any()):
        bound = targets.frames[targets.has_place]
        mask = before[targets.has_place].to(c)
        if targets.turning:
            arm = path.place[:, bound, None] - path.place[:, None, 1:]  # (B, M, N, 2)
            turn_x, turn_z = arm[..., 1], -arm[..., 0]
        else:
            turn_x = turn_z = c.new_zeros(1, 1, 1)
        shape = (len(c), len(bound), count)
        left, ahead = c.unsqueeze(1).expand(shape), s.unsqueeze(1).expand(shape)
        x = torch.stack((left, ahead, turn_x.expand(shape)), dim=-1)
        z = torch.stack((-ahead, left, turn_z.expand(shape)), dim=-1)
        rows.append((torch.stack((x, z), dim=2) * mask[None, :, None, :, None]).flatten(1, 2))
    if bool(targets.has_yaw.any()):
        turn = before[targets.has_yaw].to(c)
        nothing = torch.zeros_like(turn)
        rows.append(torch.stack((nothing, nothing, turn), dim=-1).expand(len(c), -1, -1, -1))
    return torch.cat(rows, dim=1)


def _size(place: Tensor, yaw: Tensor) -> Tensor:
    """(B,) the largest error, metres and radians alike."""
    return torch.maximum(place.detach().norm(dim=-1).amax(-1), yaw.detach().abs().amax(-1))


def _share(size: Tensor, alpha: float) -> Tensor:
    """Factor that brings a size down to alpha at most."""
    return torch.clamp(alpha / size.clamp_min(1e-12), max=1.0) if math.isfinite(alpha) else torch.ones_like(size)
