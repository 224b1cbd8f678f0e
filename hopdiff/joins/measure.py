"""How smooth the seams of joined clips are, and whether the clips before and after are what they were."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.joins.join import Joined

MOST_ACCELERATION, MOST_SPEED = 1.2, 1.2  # times the clips' own
MOST_OFF = 1e-6  # m


def seam_numbers(
    made: Clip, joined: Joined, clips: Sequence[Clip], before: Clip | None, after: Clip | None
) -> tuple[dict[str, float | list[int]], list[str]]:
    """Numbers for metrics.json, and a sentence for the user for each bar that is passed.

    made: the finished motion. clips: those that it was made of. seam_frames: the last frame of the clip before, and
    the first of the clip after. seam_speed_ratio, seam_acceleration_ratio: of joints in the world, from frame to frame,
    largest at a seam and where poses are mixed, against the largest in the clips. seam_pose_error: farthest that a
    joint of the clips before and after is from where it was [m].
    """
    places = made.joint_positions().double()
    near = joined.blends.clone()
    seams = [frame for frame, clip in ((joined.head, before), (joined.tail, after)) if clip is not None]
    for frame in seams:
        near[max(0, frame - 2) : frame + 3] = True
    ratios = []
    for order in (1, 2):
        size = rates(places, order)
        # A difference belongs to all the frames that it is made of.
        here = torch.stack([near[k : len(near) - order + k] for k in range(order + 1)]).any(0)
        own = max(float(rates(clip.joint_positions().double(), order).max()) for clip in clips if clip.frames > order)
        ratios.append(float(size[here].max()) / max(own, 1e-12))
    off = 0.0
    for part, clip in ((slice(0, joined.head + 1), before), (slice(joined.tail, None), after)):
        if clip is not None:
            off = max(off, float((places[part] - clip.joint_positions().double()).norm(dim=-1).max()))
    numbers: dict[str, float | list[int]] = {
        "seam_frames": seams,
        "seam_speed_ratio": ratios[0],
        "seam_acceleration_ratio": ratios[1],
        "seam_pose_error": off,
    }
    where = " and ".join(str(frame) for frame in seams)
    said = []
    if ratios[0] > MOST_SPEED:
        said.append(f"a joint moves {ratios[0]:.1f} times as fast as any in the clips, at the seam of frame {where}.")
    if ratios[1] > MOST_ACCELERATION:
        said.append(
            f"a joint is jerked {ratios[1]:.1f} times as hard as any in the clips, at the seam of frame {where}."
        )
    if off > MOST_OFF:
        said.append(f"the clips before and after are up to {1000 * off:.2f} mm from where they were.")
    return numbers, said


def rates(places: Tensor, order: int) -> Tensor:
    """(T - order, J) sizes of the differences of some order between frames [m]."""
    found: Tensor = places.diff(n=order, dim=0).norm(dim=-1)
    return found
