"""The runner's body with the joints that other programs expect: spine, collarbones, wrists, head, ankles and toes.

The model has eleven joints (Kang 1999, figure 2.1), and its shanks end in points. The others are put on its bones and
turn with them; feet are posed by `hopdiff.export.stance`.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from hopdiff.character import REQUIRED_PARENTS
from hopdiff.export.stance import with_feet
from hopdiff.export.take import Take
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS, full_skeleton


def is_model_body(skeleton: Skeleton) -> bool:
    """Whether a skeleton has the joints of hopdiff's characters."""
    parents = {
        name: None if parent < 0 else skeleton.names[parent]
        for name, parent in zip(skeleton.names, skeleton.parents, strict=True)
    }
    return parents == dict(REQUIRED_PARENTS)


def full_body(take: Take) -> Take:
    """A run of hopdiff's own on 22 joints. Raises HopdiffError for another skeleton, or contacts that are not known."""
    skeleton = take.clip.skeleton
    if not is_model_body(skeleton) or take.contact is None or take.feet is None:
        raise HopdiffError(f"{take.name}: only runs of hopdiff's own have the joints that joints=full begins with.")
    # Of a loop the legs of three repetitions are posed, so that those of the middle one know what came and comes.
    wide = take.repeated(3) if take.loop else take
    straight = torch.eye(3, dtype=torch.float64).expand(wide.frames, 3, 3)
    rotations = dict.fromkeys(JOINTS, straight)
    rotations |= {name: wide.clip.rotations[:, k] for k, name in enumerate(skeleton.names)}
    posed = torch.stack([rotations[name] for name in JOINTS], dim=1)
    posed = with_feet(replace(wide, clip=replace(wide.clip, skeleton=full_skeleton(skeleton), rotations=posed)))
    if take.loop:
        # The root's own turn is that of its repetition.
        posed = posed[take.frames - 1 : 2 * take.frames - 1]
        posed = torch.cat((take.clip.rotations[:, :1], posed[:, 1:]), dim=1)
    return replace(take, clip=replace(take.clip, skeleton=full_skeleton(skeleton), rotations=posed))
