"""What the user of a finished run should know besides its numbers."""

from __future__ import annotations

from hopdiff.io.run_folder import Note
from hopdiff.job import Run

OFF = 0.05  # share by which the energy may miss its target
CALM = 0.2  # below this briskness the target soon lies under the least that a body needs


def notes_of(run: Run) -> list[Note]:
    """Where a run is not what was asked for."""
    found = []
    searched = run.metrics["evaluations"] > 1
    target, reached, beta = (run.metrics[name] for name in ("energy_target", "energy_rate", "beta"))
    if target > 0 and abs(miss := reached / target - 1.0) > OFF:
        advice = (
            f"below beta {CALM:g} the target lies under what the body needs at least"
            if beta < CALM and miss > 0
            else f"raise budget.evaluations or {'lower' if miss < 0 else 'raise'} the speed"
            if searched
            else "these genes were not searched for at this briskness"
        )
        found.append(Note("energy_off_target", f"energy {100 * abs(miss):.0f} % off its target: {advice}."))
    return found
