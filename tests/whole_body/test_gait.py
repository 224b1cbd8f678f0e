"""The endless movement and its finished stride."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import pytest
import torch
from torch import Tensor

from hopdiff.types import HopdiffError
from hopdiff.whole_body.finish import phases, stride_motion, stride_times
from hopdiff.whole_body.gait import BodyGait
from hopdiff.whole_body.layout import JOINT_OF, SEGMENTS
from hopdiff.whole_body.model import BodyModel
from tests.whole_body.bodies import DTYPE, NAMES, SPEEDS, genes_of, layout_of, matrices, plain_problem, solved

SIDES = ("left", "right")
FLIP = torch.tensor([-1.0, 1.0, 1.0], dtype=DTYPE)


@cache
def gait_of(name: str, count: int = 1, wobble: float = 0.0) -> BodyGait:
    movement, body, _ = solved(name, count, wobble)
    return BodyGait.of(movement, body)


def joints_at(gait: BodyGait, times: Tensor) -> tuple[Tensor, Tensor]:
    """Places (P, T, 22, 3) and attitudes (P, T, 22, 3, 3) of the joints."""
    pose = gait.sample(times)
    return gait.layout.skeleton.forward(pose.root, pose.rotations)


def twins(gait: BodyGait) -> list[int]:
    names = gait.layout.skeleton.names
    swapped = {name: name.replace("left", "RIGHT").replace("right", "left").replace("RIGHT", "right") for name in names}
    return [names.index(swapped[name]) for name in names]


@pytest.mark.parametrize("name", NAMES)
def test_samples_at_nodes_are_the_nodes(name: str) -> None:
    movement, body, _ = solved(name)
    gait = gait_of(name)
    times = movement.grid.times[0, :-1]  # the last one belongs to the next period
    pose = gait.sample(times)
    places, attitudes = joints_at(gait, times)
    for k, segment in enumerate(SEGMENTS):
        joint = gait.layout.skeleton.index(JOINT_OF[segment])
        torch.testing.assert_close(places[0, :, joint], body.joints[0, k, :, :-1].T, rtol=0.0, atol=1e-6)
        torch.testing.assert_close(attitudes[0, :, joint], matrices(body.frames)[0, k, :-1], rtol=0.0, atol=1e-6)
    carried = body.carried
    torch.testing.assert_close(pose.com[0], carried.com[0, :, :-1].T, rtol=0.0, atol=1e-7)
    torch.testing.assert_close(pose.force[0] * 9.81, carried.force[0, ..., :-1].permute(2, 0, 1), rtol=0.0, atol=1e-6)
    for side in (0, 1):
        # At the ends of phases two curves meet.
        inner = torch.ones(len(times), dtype=torch.bool)
        for phase in range(len(movement.grid.nodes)):
            here = movement.grid.slice(phase)
            inner[here.start] = False
            inner[min(here.stop - 1, len(times) - 1)] = False
        standing = inner & pose.contact[0, :, side]
        assert torch.equal(standing, inner & (carried.force[0, side, 1, :-1].abs() > 0.0))
        wanted = carried.cop[0, side, :, :-1].T
        torch.testing.assert_close(pose.cop[0, standing, side], wanted[standing], rtol=0.0, atol=1e-7)
    torch.testing.assert_close(pose.curves["left_knee"][0], body.angles.knee[0, 0, :-1], rtol=0.0, atol=1e-7)
    ankle = body.angles.foot - body.angles.thigh + body.angles.knee
    torch.testing.assert_close(pose.curves["right_ankle"][0], ankle[0, 1, :-1], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["run", "walk"])
def test_the_second_step_is_the_mirror_image_of_the_first(name: str) -> None:
    gait = gait_of(name)
    step = float(gait.grid.total)
    times = torch.linspace(0.013, 0.97, 23, dtype=DTYPE) * step
    order = twins(gait)
    first, second = (joints_at(gait, times + k * step) for k in (0, 1))
    way = torch.tensor([0.0, 0.0, float(gait.way)], dtype=DTYPE)
    torch.testing.assert_close(second[0], first[0][:, :, order] * FLIP + way, rtol=0.0, atol=1e-9)
    torch.testing.assert_close(second[1], FLIP[:, None] * first[1][:, :, order] * FLIP, rtol=0.0, atol=1e-9)
    poses = [gait.sample(times + k * step) for k in (0, 1)]
    assert torch.equal(poses[1].contact, poses[0].contact.flip(-1))
    torch.testing.assert_close(poses[1].force, poses[0].force.flip(2) * FLIP, rtol=0.0, atol=1e-9)
    torch.testing.assert_close(poses[1].com, poses[0].com * FLIP + way, rtol=0.0, atol=1e-9)
    torch.testing.assert_close(poses[1].curves["left_hip"], poses[0].curves["right_hip"], rtol=0.0, atol=1e-9)
    torch.testing.assert_close(poses[1].curves["pelvis_yaw"], -poses[0].curves["pelvis_yaw"], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_strides_repeat_without_a_jump(name: str) -> None:
    gait = gait_of(name)
    stride = float(gait.stride_time)
    steps = 2 if gait.plan.mirrored else 1
    way = torch.tensor([0.0, 0.0, steps * float(gait.way)], dtype=DTYPE)
    times = torch.linspace(0.0, stride, 41, dtype=DTYPE)[:-1] + 0.003
    near, far = joints_at(gait, times), joints_at(gait, times + 5.0 * stride)
    torch.testing.assert_close(far[0], near[0] + 5.0 * way, rtol=0.0, atol=1e-8)
    torch.testing.assert_close(far[1], near[1], rtol=0.0, atol=1e-8)
    tiny = 1e-6
    ends = torch.cat((gait.contacts.flatten(), torch.tensor([0.0, 0.5 * stride, stride], dtype=DTYPE)))
    before, after = (joints_at(gait, ends.clamp_min(0.1 * stride) + shift)[0] for shift in (-tiny, tiny))
    assert float((after - before).abs().max()) < 20.0 * 2.0 * tiny


@pytest.mark.parametrize("name", NAMES)
def test_contacts_are_those_of_the_plan(name: str) -> None:
    gait, durations = gait_of(name), gait_of(name).grid.durations[0]
    step, stride = float(durations.sum()), float(gait.stride_time)
    spans = {
        "run": [[0.0, float(durations[0])], [step, step + float(durations[0])]],
        "walk": [[0.0, step + float(durations[0])], [step, 2.0 * step + float(durations[0])]],
        "hop": [[0.0, float(durations[0])]] * 2,
        "limp": [[0.0, float(durations[0])], [float(durations[:2].sum()), float(durations[:3].sum())]],
    }[name]
    torch.testing.assert_close(gait.contacts[0], torch.tensor(spans, dtype=DTYPE))
    assert stride == pytest.approx(2.0 * step if gait.plan.mirrored else step)
    torch.testing.assert_close(gait.contact_times, gait.contacts[..., 1] - gait.contacts[..., 0])
    times = torch.arange(0.0005, 2.0 * stride, 0.001, dtype=DTYPE)
    contact = gait.sample(times).contact[0]
    for side in (0, 1):
        # A walk's right contact runs on into the next stride.
        down, off = spans[side]
        wanted = ((times - down) % stride) < off - down
        assert float((contact[:, side] != wanted).double().mean()) < 1e-3
        assert 0.1 < float(contact[:, side].double().mean()) < 0.75


@pytest.mark.parametrize("name", ["run", "limp"])
def test_the_finished_stride(name: str) -> None:
    gait = gait_of(name)
    motion = stride_motion(gait, 60.0)
    stride = float(gait.stride_time)
    count = round(stride * 60.0)
    assert len(motion.times) == count + 1
    assert float(motion.times[-1]) == pytest.approx(stride)
    torch.testing.assert_close(motion.times.diff(), torch.full((count,), stride / count, dtype=DTYPE))
    places, attitudes = motion.clip.forward()
    way = torch.tensor([0.0, 0.0, 3.5 * stride], dtype=DTYPE)
    torch.testing.assert_close(places[-1], places[0] + way, rtol=0.0, atol=1e-6)
    torch.testing.assert_close(attitudes[-1], attitudes[0], rtol=0.0, atol=1e-6)
    assert torch.equal(motion.contact[-1], motion.contact[0])
    assert bool(motion.contact[0, 0])
    assert motion.force is not None
    assert motion.cop is not None
    # In the air nothing pushes; standing feet are pushed up, and held up where they are pushed.
    assert float(motion.force[~motion.contact].abs().max()) == 0.0
    assert float(motion.force[..., 1].mean(0).sum()) == pytest.approx(1.0, abs=0.05)
    torch.testing.assert_close(motion.leg_force, motion.force.norm(dim=-1))
    for k in (0, 1):
        standing = motion.contact[:, k]
        torch.testing.assert_close(motion.com_target[standing], motion.cop[standing, k])
        torch.testing.assert_close(motion.feet[standing, k], motion.cop[standing, k])
    # What holds the body up goes evenly from foot to foot while it is in the air.
    air = ~motion.contact.any(-1)
    assert 5 < int(air.sum()) < count // 2
    frames = (~air).nonzero().flatten().tolist()
    for before, after in pairwise(frames):
        ends = motion.com_target[before], motion.com_target[after]
        for k in range(before + 1, after):
            share = (k - before) / (after - before)
            torch.testing.assert_close(motion.com_target[k], ends[0] + share * (ends[1] - ends[0]))
    assert set(motion.angles) >= {f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "elbow")}


@pytest.mark.parametrize("name", ["run", "limp"])
@pytest.mark.parametrize("strides", [1, 3])
def test_phases_follow_each_other_through_the_strides(name: str, strides: int) -> None:
    gait = gait_of(name)
    found = phases(gait, strides)
    assert [(p.kind, p.side) for p in found] == strides * [(k, s) for s in SIDES for k in ("stance", "flight")]
    assert found[0].start == 0.0
    assert found[-1].end == pytest.approx(strides * float(gait.stride_time))
    for one, following in pairwise(found):
        assert one.end == pytest.approx(following.start)
        assert one.end > one.start
    assert found[0].end - found[0].start == pytest.approx(float(gait.contact_times[0, 0]))
    assert found[3].end - found[3].start == pytest.approx(float(gait.flight_times[0, 1]))


def test_feet_of_a_run_do_not_go_below_the_ground() -> None:
    """Heels, balls and tips of the toes, which bend on the ground; the shoe's sole is what they stand on."""
    gait = gait_of("run")
    layout = gait.layout
    times = torch.linspace(0.0, float(gait.stride_time), 501, dtype=DTYPE)
    places, attitudes = joints_at(gait, times)
    contact = gait.sample(times).contact
    for k, side in enumerate(SIDES):
        ankle, toe = (layout.skeleton.index(f"{side}_{joint}") for joint in ("ankle", "toe"))
        heel = places[:, :, ankle] + attitudes[:, :, ankle] @ layout.heel
        ball = places[:, :, toe]
        tip = ball + attitudes[:, :, toe] @ (layout.toe - layout.ball)
        assert float(heel[..., 1].min()) > -1e-6
        assert float(ball[..., 1].min()) > -1e-6
        standing = contact[0, :, k]
        assert float(tip[..., 1].min()) > -1e-6
        lowest = torch.minimum(heel[..., 1], ball[..., 1])[0]
        assert float(lowest[standing].max()) < 5e-3
        assert float(lowest[~standing].max()) > 0.05


def test_toes_lie_flat_while_the_heel_rises() -> None:
    gait = gait_of("run")
    end = float(gait.contacts[0, 0, 1])
    times = torch.linspace(0.5 * end, end, 11, dtype=DTYPE)
    _, attitudes = joints_at(gait, times)
    toe = attitudes[0, :, gait.layout.skeleton.index("left_toe")]
    heel = attitudes[0, :, gait.layout.skeleton.index("left_ankle")]
    assert float(heel[-1, 1, 2]) < -0.4
    # Before it has risen, the foot may have its toes up a little: there they do not bend.
    assert float(toe[:, 1, 2].abs().max()) < 0.03
    later = joints_at(gait, torch.tensor([end + 0.9 * (float(gait.stride_time) - end)], dtype=DTYPE))[1][0, 0]
    names = gait.layout.skeleton
    torch.testing.assert_close(later[names.index("left_toe")], later[names.index("left_ankle")])
    # Straight a quarter of the swing after take-off, although the foot still points down.
    swing = float(gait.stride_time) - end
    eased = joints_at(gait, torch.tensor([end + share * swing for share in (0.05, 0.26)], dtype=DTYPE))[1][0]
    toe, heel = eased[:, names.index("left_toe")], eased[:, names.index("left_ankle")]
    assert float(heel[1, 1, 2]) < -0.4
    torch.testing.assert_close(toe[1], heel[1])
    assert float((toe[0] - heel[0]).abs().max()) > 0.1


@pytest.mark.parametrize("which", [0, 1, 2])
def test_candidates_do_not_mix(which: int) -> None:
    gait = gait_of("run", 3, 0.05)
    movement, body, _ = solved("run", 3, 0.05)
    rows = slice(which, which + 1)
    alone = BodyGait(
        gait.layout,
        gait.plan,
        type(gait.grid)(gait.grid.nodes, gait.grid.durations[rows]),
        gait.channels[rows],
        gait.abduction[rows],
        gait.inward[rows],
        gait.way[rows],
    )
    times = torch.linspace(-0.4, 1.7, 37, dtype=DTYPE)
    for found, wanted in zip(gait.sample(times), alone.sample(times), strict=True):
        if isinstance(found, Tensor):
            torch.testing.assert_close(found[which], wanted[0], rtol=0.0, atol=1e-12)
    torch.testing.assert_close(gait.contacts[which], alone.contacts[0])
    assert gait.channels.shape == (3, len(gait.channels[0]), body.root.shape[-1])
    assert movement.grid is gait.grid


def test_frames_need_a_rate_that_tells_a_stride() -> None:
    gait = gait_of("run")
    with pytest.raises(HopdiffError, match=r"fps=3 is too low for a stride of 0\.\d+ s: at least \d+\."):
        stride_times(gait, 3.0)
    assert len(stride_times(gait, 30.0)) == round(30.0 * float(gait.stride_time)) + 1


def test_the_problem_writes_the_stride_of_its_candidate() -> None:
    problem = plain_problem()
    motion = problem.motion(problem.start, 50.0)
    wanted = stride_motion(problem.gait(problem.start.unsqueeze(0)), 50.0)
    assert torch.equal(motion.clip.rotations, wanted.clip.rotations)
    assert torch.equal(motion.com, wanted.com)


def test_lame_on_the_right_is_the_mirror_image_of_lame_on_the_left() -> None:
    genes, speed = genes_of("limp"), torch.tensor([SPEEDS["limp"]], dtype=DTYPE)
    character = layout_of().character
    left, right = (BodyModel.limping(character, 11, 8, side, 0.3).gait(genes, speed) for side in ("left", "right"))
    assert torch.allclose(right.contact_times, left.contact_times.flip(-1))
    times = torch.linspace(0.0, 1.5, 40, dtype=DTYPE)
    one, other = left.sample(times), right.sample(times + right.contacts[0, 1, 0])
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=DTYPE)
    assert torch.allclose(other.force, one.force.flip(2) * flip, atol=1e-9)
    way = (other.com - one.com * flip)[0]
    assert float((way - way[:1]).abs().max()) < 1e-9
    assert float(right.sample(torch.zeros(1, dtype=DTYPE)).com[0, 0, 2].abs()) < 1e-9
