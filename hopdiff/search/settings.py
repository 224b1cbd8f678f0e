"""Checks of the settings that users write."""

from __future__ import annotations

from hopdiff.types import HopdiffError


def require(option: str, value: float, low: float, high: float = float("inf")) -> None:
    """Raises HopdiffError unless low <= value <= high."""
    if not low <= value <= high:
        wanted = f"at least {low}" if high == float("inf") else f"from {low} to {high}"
        raise HopdiffError(f"search.{option} must be {wanted}, not {value}.")
