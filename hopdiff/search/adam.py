"""Adam in the box, many starts side by side."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

DECAYS = 0.9, 0.99


class Adam(NamedTuple):
    """P descents. x, last: (P, G), the next trial and the last point with a value. value: (P,) there.

    mean, square: (P, G) running averages of the gradient and of its square. age: (P,) steps taken of `steps`, over
    which the rate falls to nothing along half a cosine. rate: box widths a step; scale: (P,) its factor, halved at
    every trial without a value.
    """

    x: Tensor
    last: Tensor
    value: Tensor
    mean: Tensor
    square: Tensor
    scale: Tensor
    age: Tensor
    done: Tensor
    rate: float
    steps: int

    @classmethod
    def begin(cls, x: Tensor, rate: float, steps: int) -> Adam:
        zeros = torch.zeros_like(x)
        count = torch.zeros(len(x), dtype=torch.int64, device=x.device)
        inf = x.new_full((len(x),), math.inf)
        return cls(x, x, inf, zeros, zeros, torch.ones_like(inf), count, count > 0, rate, steps)

    def trial(self) -> Tensor:
        """(P, G) points to be evaluated next."""
        return self.x

    def advance(self, x: Tensor, value: Tensor, gradient: Tensor) -> Adam:
        """What the trial `x` (P, G), its value (P,), +inf allowed, and gradient (P, G) teach."""
        good = value.isfinite()
        age = self.age + good
        keep, keep_square = DECAYS
        mean = torch.where(good[:, None], keep * self.mean + (1 - keep) * gradient, self.mean)
        square = torch.where(good[:, None], keep_square * self.square + (1 - keep_square) * gradient**2, self.square)
        scale = torch.where(good, self.scale, 0.5 * self.scale)
        last = torch.where(good[:, None], x, self.last)
        passed = age.to(x.dtype)  # quotients and powers of whole numbers would be of single precision
        rate = self.rate * scale * 0.5 * (1 + torch.cos(math.pi * passed.clamp(max=self.steps) / self.steps))
        steps = passed[:, None].clamp(min=1)
        unbiased = mean / (1 - keep**steps)
        spread = (square / (1 - keep_square**steps)).sqrt()
        step = rate[:, None] * unbiased / (spread + torch.finfo(x.dtype).tiny)
        return self._replace(
            x=(last - step).clamp(0.0, 1.0),
            last=last,
            value=torch.where(good, value, self.value),
            mean=mean,
            square=square,
            scale=scale,
            age=age,
            done=self.done | (age >= self.steps) | (scale < 1e-3),
        )
