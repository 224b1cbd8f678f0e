# No `from __future__ import annotations`: the shapes are read when the functions are defined.
"""Shapes of the public entry points, checked by jaxtyping: one letter, one size within a call."""

import pytest
import torch
from beartype import beartype
from jaxtyping import Bool, Float, Int, TypeCheckError, jaxtyped
from torch import Tensor

from hopdiff.composing import compose
from hopdiff.config import DTYPES, build_job
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import euler_to_matrix, matrix_to_euler
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.motion import Motion
from hopdiff.problem import RunProblem
from hopdiff.search.base import Eval, Problem

shaped = jaxtyped(typechecker=beartype)


@shaped
def priced(
    genes: Float[Tensor, "P G"], result: Eval
) -> tuple[Float[Tensor, "P"], Float[Tensor, "P G"], Float[Tensor, "P"], Int[Tensor, "P"]]:
    assert result.grad is not None
    for term in result.terms.values():
        one_each(genes, term)
    return result.cost, result.grad, result.merit, result.status


@shaped
def one_each(genes: Float[Tensor, "P G"], term: Float[Tensor, "P"]) -> None: ...


@shaped
def kinematics(
    skeleton: Skeleton, root: Float[Tensor, "*batch 3"], rotations: Float[Tensor, "*batch J 3 3"]
) -> tuple[Float[Tensor, "*batch J 3"], Float[Tensor, "*batch J 3 3"]]:
    return skeleton.forward(root, rotations)


@shaped
def there_and_back(angles: Float[Tensor, "*batch 3"], order: str) -> Float[Tensor, "*batch 3"]:
    return matrix_to_euler(euler_to_matrix(angles, order), order)


@shaped
def frames(
    times: Float[Tensor, "T"],
    contact: Bool[Tensor, "T 2"],
    feet: Float[Tensor, "T 2 3"],
    com: Float[Tensor, "T 3"],
    com_target: Float[Tensor, "T 3"],
    leg_force: Float[Tensor, "T 2"],
    root: Float[Tensor, "T 3"],
    rotations: Float[Tensor, "T J 3 3"],
    offsets: Float[Tensor, "J 3"],
    joints: Float[Tensor, "T J 3"],
) -> None: ...


@shaped
def curve(times: Float[Tensor, "T"], angle: Float[Tensor, "T"]) -> None: ...


def check_motion(motion: Motion) -> None:
    clip: Clip = motion.clip
    fields = (motion.times, motion.contact, motion.feet, motion.com, motion.com_target, motion.leg_force)
    frames(*fields, clip.root_position, clip.rotations, clip.skeleton.offsets, clip.joint_positions())
    for angle in motion.angles.values():
        curve(motion.times, angle)
    for end in clip.end_positions().values():
        assert end.shape == clip.root_position.shape


@pytest.fixture(params=[(model, dtype) for model in ("smooth", "thesis") for dtype in DTYPES], ids="-".join)
def problem(request: pytest.FixtureRequest) -> RunProblem:
    model, dtype = request.param
    return build_job(compose([f"model={model}", f"dtype={dtype}"])).problem


@pytest.mark.few(3)
@pytest.mark.parametrize("population", [1, 5])
def test_prices(problem: RunProblem, population: int) -> None:
    assert isinstance(problem, Problem)
    generator = torch.Generator().manual_seed(0)
    genes = torch.rand(population, problem.dimension, generator=generator, dtype=torch.float64).to(problem.dtype)
    result = problem.evaluate(genes, with_grad=True)
    for part in priced(genes, result)[:3]:
        assert part.dtype == problem.dtype
    assert problem.evaluate(genes, with_grad=False).grad is None


def test_motion(problem: RunProblem) -> None:
    motion = problem.motion(problem.ordinary_genes, 30.0)
    check_motion(motion)
    assert motion.clip.rotations.dtype == problem.dtype


@pytest.mark.few(5)
@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_geometry(problem: RunProblem, batch: tuple[int, ...]) -> None:
    skeleton = problem.character.skeleton
    joints = len(skeleton.names)
    eye = torch.eye(3, dtype=problem.dtype).expand(*batch, joints, 3, 3)
    kinematics(skeleton, torch.zeros(*batch, 3, dtype=problem.dtype), eye)
    there_and_back(torch.zeros(*batch, 3, dtype=problem.dtype), "ZXY")


def test_the_checks_can_fail() -> None:
    with pytest.raises(TypeCheckError):
        one_each(torch.zeros(3, 2), torch.zeros(2))
    with pytest.raises(TypeCheckError):
        curve(torch.zeros(3), torch.zeros(3, 1))
