"""Motion models by name."""

from __future__ import annotations

from hopdiff.character import Character
from hopdiff.models.base import Model, ModelSettings
from hopdiff.models.limp import LimpSettings
from hopdiff.models.smooth import SmoothModel
from hopdiff.models.thesis import ThesisModel
from hopdiff.types import HopdiffError
from hopdiff.whole_body.model import BodyModel

MODELS = ("body", "smooth", "thesis")


def build_model(settings: ModelSettings, character: Character, limp: LimpSettings | None = None) -> Model | BodyModel:
    """Raises HopdiffError, naming the setting, for an unknown model or a number out of range."""
    if settings.name not in MODELS:
        raise HopdiffError(f"model.name must be one of {', '.join(MODELS)}, not {settings.name!r}.")
    if not 4 <= settings.rounds <= 100:
        raise HopdiffError(f"model.rounds must lie between 4 and 100, not {settings.rounds}.")
    if not 1 <= settings.adjoint_rounds <= 100:
        raise HopdiffError(f"model.adjoint_rounds must lie between 1 and 100, not {settings.adjoint_rounds}.")
    if not 4 <= settings.nodes <= 64:
        raise HopdiffError(f"model.nodes must lie between 4 and 64, not {settings.nodes}.")
    if not 1 <= settings.sweeps <= 100:
        raise HopdiffError(f"model.sweeps must lie between 1 and 100, not {settings.sweeps}.")
    if not 1e-4 <= settings.step <= 0.02:
        raise HopdiffError(f"model.step must lie between 0.0001 and 0.02 s, not {settings.step:g}.")
    if not 0 <= settings.strides <= 1000:
        raise HopdiffError(f"model.strides must lie between 0 and 1000, not {settings.strides}.")
    if limp is not None:
        limp.check()
        limp = limp if limp.amount > 0 else None
    if settings.name == "body":
        if limp is not None:
            return BodyModel.limping(character, settings.rounds, settings.adjoint_rounds, limp.leg, limp.amount)
        return BodyModel(character, settings.rounds, settings.adjoint_rounds)
    if settings.name == "thesis":
        return ThesisModel(character, settings.step, settings.strides, limp)
    return SmoothModel(character, settings.nodes, settings.sweeps, limp)
