# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""Motion models by name, each with its settings; their defaults stand in conf/model/."""

from dataclasses import dataclass, fields

from hopdiff.character import Character
from hopdiff.genes import GeneSettings
from hopdiff.messages import choose
from hopdiff.models.active_leg import KNEES
from hopdiff.models.base import STIFFNESS, Model
from hopdiff.models.limp import LimpSettings
from hopdiff.models.smooth import SmoothModel
from hopdiff.models.thesis import ThesisModel
from hopdiff.types import HopdiffError
from hopdiff.whole_body.model import BodyModel

AnyModel = Model | BodyModel


@dataclass
class BodySettings:
    """rounds, adjoint_rounds: of the whole-body model's solution and of its gradient."""

    name: str
    rounds: int
    adjoint_rounds: int

    def build(self, character: Character, limp: LimpSettings | None) -> BodyModel:
        """Raises HopdiffError, naming the setting, for a number out of range."""
        _within(self, rounds=(4, 100), adjoint_rounds=(1, 100))
        if limp is not None:
            return BodyModel.limping(character, self.rounds, self.adjoint_rounds, limp.leg, limp.amount)
        return BodyModel(character, self.rounds, self.adjoint_rounds)


@dataclass
class SmoothSettings:
    """nodes: Chebyshev nodes per phase. sweeps: corrections of the balance with the true body."""

    name: str
    nodes: int
    sweeps: int

    def build(self, character: Character, limp: LimpSettings | None) -> SmoothModel:
        """Raises HopdiffError, naming the setting, for a number out of range."""
        _within(self, nodes=(4, 64), sweeps=(1, 100))
        return SmoothModel(character, self.nodes, self.sweeps, limp)


@dataclass
class ThesisSettings:
    """step: frame interval h of the stepping equations [s]. strides: run before the one that is kept.

    knee: printed, flexion or joined. impulse: whether the energy counts the jump of the rates at take-off.
    """

    name: str
    step: float
    strides: int
    knee: str
    impulse: bool

    def build(self, character: Character, limp: LimpSettings | None) -> ThesisModel:
        """Raises HopdiffError, naming the setting, for a number out of range."""
        _within(self, step=(1e-4, 0.02), strides=(0, 1000))
        choose("model.knee", self.knee, KNEES)
        return ThesisModel(character, self.step, self.strides, limp, self.knee, self.impulse)


ModelSettings = BodySettings | SmoothSettings | ThesisSettings
MODELS: dict[str, type] = {"body": BodySettings, "smooth": SmoothSettings, "thesis": ThesisSettings}


def gene_table(model: str, genes: GeneSettings) -> str:
    """The table in conf/genes/ whose genes this one may hold, which the model can read.

    Raises HopdiffError for the genes of the thesis with another model.
    """
    if model == "body":
        return "body"
    if STIFFNESS not in genes.genes:
        return "default"
    if model != "thesis":
        raise HopdiffError(f"genes={genes.name} are those of model=thesis: model={model} takes genes=default.")
    return "thesis"


def _within(settings: ModelSettings, **ranges: tuple[float, float]) -> None:
    """Raises HopdiffError, naming the setting, for a number out of its range."""
    units = {"step": " s"}
    for entry in fields(settings):
        if entry.name in ranges:
            value, (low, high) = getattr(settings, entry.name), ranges[entry.name]
            if not low <= value <= high:
                unit = units.get(entry.name, "")
                raise HopdiffError(
                    f"model.{entry.name} must lie between {low:g} and {high:g}{unit}, not {value:g}{unit}."
                )
