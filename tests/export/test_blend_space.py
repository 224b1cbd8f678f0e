from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation, Slerp

from hopdiff.export.blend_space import BlendSpace, blend, sliding, stride_length
from hopdiff.export.contact_events import contact_events
from hopdiff.export.prepare import prepared
from hopdiff.export.take import Take
from hopdiff.export.write import write_exports
from hopdiff.types import HopdiffError
from tests.builders import make_character, make_problem, valid_genes
from tests.export.gltf import Gltf
from tests.export.takes import own
from tests.export.test_player import Elements
from tests.export.test_write import preset

SPEEDS, BETAS = (3.0, 4.0), (0.2, 0.7)


@cache
def runs() -> tuple[Take, ...]:
    """Quick runs of one body, two speeds and two betas, each with a stride time of its own."""
    body = make_character()
    masses = dict(zip(body.skeleton.names, body.masses.tolist(), strict=True))
    found = []
    for speed in SPEEDS:
        for beta in BETAS:
            problem = make_problem(f"speed={speed}", f"beta={beta}")
            genes = valid_genes(problem, 1, seed=2 if beta == BETAS[0] else 5)[0]
            numbers = {"speed": speed, "beta": beta}
            found.append(Take.of_motion(f"run_{speed:g}_{beta:g}", problem.motion(genes, 60.0), masses, numbers))
    return tuple(found)


@cache
def space() -> BlendSpace:
    settings = preset("blendspace")
    return BlendSpace.of([prepared(take, settings) for take in runs()])


def test_clips_are_alike_in_phase_and_on_a_grid() -> None:
    found = space()
    assert (found.speeds, found.betas, found.turns, found.missing) == (SPEEDS, BETAS, (0.0,), [])
    index = found.index()
    assert index["keys"] == 64
    assert len({clip["stride_time"] for clip in index["clips"]}) > 1
    for clip, source in zip(index["clips"], runs(), strict=True):
        assert (clip["name"], clip["speed"], clip["beta"]) == (
            source.name,
            source.numbers["speed"],
            source.numbers["beta"],
        )
        assert clip["stride_length"] / clip["stride_time"] == pytest.approx(clip["speed"], rel=1e-3)
        assert [event["name"] for event in clip["contacts"]] == ["LeftDown", "LeftUp", "RightDown", "RightUp"]
        for event, before in zip(clip["contacts"], contact_events(source), strict=True):
            assert event["phase"] == pytest.approx(before.phase, abs=0.005)
        assert clip["contacts"][0]["phase"] == pytest.approx(0.0, abs=1e-4)


def test_a_grid_need_not_be_full_and_says_what_is_missing() -> None:
    found = BlendSpace.of(list(space().clips.values())[:3])
    assert found.missing == [(4.0, 0.7, 0.0)]
    assert found.index()["missing"] == [{"speed": 4.0, "beta": 0.7, "turn": 0.0}]
    assert len(found.edges()) == 2
    assert len(space().edges()) == 4


def test_a_blend_is_between_its_clips() -> None:
    first, _, third, _ = space().clips.values()
    alone = blend([first, third], (1.0, 0.0))
    torch.testing.assert_close(alone.clip.joint_positions(), first.clip.joint_positions(), atol=1e-9, rtol=0)
    half = blend([first, third], (0.5, 0.5))
    assert half.clip.duration == pytest.approx(0.5 * (first.clip.duration + third.clip.duration))
    assert stride_length(half) == pytest.approx(0.5 * (stride_length(first) + stride_length(third)))
    # Halfway the sum of quaternions is the middle of the arc.
    for frame in (0, 17, 40):
        for joint in range(len(first.clip.skeleton.names)):
            ends = Rotation.from_matrix(np.stack([one.clip.rotations[frame, joint].numpy() for one in (first, third)]))
            middle = Slerp([0.0, 1.0], ends)(0.5).as_matrix()
            np.testing.assert_allclose(half.clip.rotations[frame, joint].numpy(), middle, atol=1e-9)


def test_a_blend_of_bones_that_stay_with_some_that_move() -> None:
    first, _, third, _ = space().clips.values()
    bones = first.clip.skeleton.offsets.expand(first.frames, -1, -1).clone()
    moving = replace(first, clip=replace(first.clip, offsets=1.2 * bones))
    for pair, share in (((moving, third), 0.25), ((third, moving), 0.75)):
        found = blend(pair, (share, 1.0 - share)).clip.offsets
        assert found is not None
        torch.testing.assert_close(found[:, 1:], 1.05 * bones[:, 1:], atol=1e-9, rtol=0)


def test_sliding_is_how_fast_standing_feet_move() -> None:
    """A body that goes too far for its feet by a tenth slides by a tenth of its speed."""
    take = space().clips[3.0, 0.2, 0.0]
    assert take.way is not None
    still, further = sliding(take), sliding(replace(take, way=1.1 * take.way))
    assert still is not None
    assert further is not None
    assert still < 0.06
    assert further == pytest.approx(0.3, abs=0.06)
    between = [sliding(blend(pair, (0.5, 0.5))) for pair in space().edges()]
    assert all(one is not None and one < 0.15 for one in between)
    assert sliding(replace(take, contact=None)) is None


def test_files_of_a_blend_space(tmp_path: Path) -> None:
    written = [path for path, _ in write_exports(runs(), {"blendspace": preset("blendspace")}, tmp_path)]
    assert [path.name for path in written] == ["blendspace.glb", "blendspace.json", "blendspace.html"]
    file, index = Gltf.of(written[0].read_bytes()), json.loads(written[1].read_text())
    assert [one["name"] for one in file.content["animations"]] == [clip["name"] for clip in index["clips"]]
    assert len(file.content["skins"]) == len(file.content["meshes"]) == 1
    for animation, clip in zip(file.content["animations"], index["clips"], strict=True):
        keys = {len(file.values(sampler["input"])) for sampler in animation["samplers"]}
        assert keys <= {2, 65}
        times = file.values(animation["samplers"][0]["input"])[:, 0]
        assert times[-1] == pytest.approx(clip["stride_time"], abs=1e-5)
    elements = Elements(written[2].read_text(encoding="utf-8"))
    assert not [tag for tag, _ in elements.found if tag in ("link", "img", "iframe", "object", "base")]
    assert all(not {"src", "href", "srcset", "action"} & set(attributes) for _, attributes in elements.found)
    assert json.loads(elements.scripts[0])["clips"] == index["clips"]


def test_what_cannot_be_blended_is_refused(tmp_path: Path) -> None:
    clips = list(space().clips.values())
    body = clips[1].clip.skeleton
    tall = replace(clips[1], clip=replace(clips[1].clip, skeleton=replace(body, offsets=1.1 * body.offsets)))
    heavy = replace(clips[1], masses={part: 2.0 * mass for part, mass in (clips[1].masses or {}).items()})
    ends = {name: 1.1 * end for name, end in body.end_sites.items()}
    long = replace(clips[1], clip=replace(clips[1].clip, skeleton=replace(body, end_sites=ends)))
    for takes, message in (
        ([clips[0], replace(clips[0], name="b")], r"run_3_0.2 and b are both of speed 3, beta 0.2 and turn 0"),
        ([clips[0], tall], r"run_3_0.7 is of another body than run_3_0.2"),
        ([clips[0], heavy], r"run_3_0.7 is of another body than run_3_0.2"),
        ([clips[0], long], r"run_3_0.7 is of another body than run_3_0.2"),
        ([replace(clips[0], numbers={})], r"run_3_0.2 has no place in a blend space: its speed is not known"),
        ([clips[0], replace(clips[1], loop=False)], r"run_3_0.7 is no loop, it does not end as it began"),
        ([clips[0], clips[1].at(torch.arange(9).double(), 0.02)], r"run_3_0.7 has other keys than run_3_0.2: set keys"),
    ):
        with pytest.raises(HopdiffError, match=message):
            BlendSpace.of(takes)
    for override in ("keys=null", "cycles=2"):
        with pytest.raises(HopdiffError, match=r"kind blendspace are single strides"):
            preset("blendspace", override)
    with pytest.raises(HopdiffError, match=r"two exports are called 'blendspace\.json'"):
        exports = {"blendspace": preset("blendspace"), "events": preset("events", "file=blendspace.json")}
        write_exports([own()], exports, tmp_path)
    assert not list(tmp_path.iterdir())
