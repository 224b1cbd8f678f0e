"""What comes out, in words: a sentence or two for every figure, from the numbers of its runs."""

from __future__ import annotations

from statistics import median

from experiments.gallery import Numbers


def body(numbers: Numbers) -> str:
    m = numbers["fig_2_1"]
    return (
        f"The default character has the same eleven joints: {m['height']:.2f} m, {m['mass']:.0f} kg, legs of"
        f" {m['leg_length']:.2f} m. Lengths and masses are people's (de Leva 1996)."
    )


def edits(numbers: Numbers) -> str:
    rows = sorted(numbers["fig_2_2"]["rows"], key=lambda row: float(row["leg_length"]))
    found = "; ".join(
        f"legs of {float(r['leg_length']):.2f} m: steps of {float(r['step_length']):.2f} m, contact"
        f" {float(r['contact_time']):.3f} s"
        for r in rows
    )
    own, child = numbers["fig_2_2_human"], numbers["fig_2_2_child"]
    return (
        f"Every body gets a run of its own at {float(rows[0]['speed']):g} m/s: {found}. The genes of one run also"
        f" replay on another body: at {own['speed']:g} m/s steps of {own['step_length']:.2f} m on the adult become"
        f" {child['step_length']:.2f} m on the child."
    )


def hopper(numbers: Numbers, name: str) -> str:
    m = numbers[name]
    if m["periodic"]:
        return (
            f"The hop repeats itself: contact {m['contact_time']:.3f} s, flight {m['flight_time']:.3f} s, touchdown at"
            f" {m['touchdown_rate']:.2f} m/s downward. Started without downward speed it is drawn into the same hop."
        )
    heights = ", ".join(f"{height:.2f}" for height in m["apex_heights"])
    return (
        f"There is no cycle: from one hop to the next HIP rises higher, to {heights} m. First contact"
        f" {m['contact_time']:.3f} s, first flight {m['flight_time']:.3f} s."
    )


def balance(numbers: Numbers) -> str:
    parts = []
    for model, suffix in (("thesis", ""), ("smooth", "_smooth")):
        slow, fast = numbers[f"fig_3_11{suffix}"], numbers[f"fig_3_12{suffix}"]
        parts.append(
            f"`{model}`: over a stride the trunk swings {slow['trunk_lean_range_deg']:.1f} deg fore and aft and"
            f" {slow['trunk_side_range_deg']:.1f} deg sideways at 1 m/s, {fast['trunk_lean_range_deg']:.1f} and"
            f" {fast['trunk_side_range_deg']:.1f} deg at 5 m/s"
        )
    return "; ".join(parts) + "."


def limp(numbers: Numbers) -> str:
    parts = []
    for model, name in (("thesis", "fig_3_13"), ("smooth", "fig_3_13_smooth")):
        m = numbers[name]
        side = "right, the sound leg's side" if m["trunk_side_deg"] < 0 else "left, the lame leg's side"
        parts.append(
            f"`{model}`: the lame left leg carries {m['contact_time_left']:.3f} s, the right one"
            f" {m['contact_time_right']:.3f} s; the trunk leans {abs(m['trunk_side_deg']):.1f} deg to the {side}"
        )
    return "; ".join(parts) + "."


def track(numbers: Numbers) -> str:
    return (
        "; ".join(
            f"`{m['model']}`: the target moves {100 * m['step_width']:.1f} cm from foot to foot, the centre of mass"
            f" {100 * m['com_side_range']:.2f} cm"
            for m in (numbers["fig_3_14"], numbers["fig_3_14_smooth"])
        )
        + "."
    )


def speeds(numbers: Numbers) -> str:
    steps = [
        f"{numbers[name]['speed']:g} m/s: {numbers[name]['step_frequency']:.2f} steps/s of"
        f" {numbers[name]['step_length']:.2f} m (smooth: {numbers[name + '_smooth']['step_frequency']:.2f} of"
        f" {numbers[name + '_smooth']['step_length']:.2f} m)"
        for name in ("fig_5_1", "fig_5_2", "fig_5_3")
    ]
    return "; ".join(steps) + "."


def brisk(numbers: Numbers) -> str:
    calm, lively = numbers["fig_5_4"], numbers["fig_5_5"]
    ours = numbers["fig_5_4_smooth"], numbers["fig_5_5_smooth"]
    return (
        f"From beta .2 to .7 the arms swing {calm['arm_swing_deg']:.0f} and {lively['arm_swing_deg']:.0f} deg, the"
        f" centre of mass bounces {100 * calm['com_oscillation']:.1f} and {100 * lively['com_oscillation']:.1f} cm"
        f" (smooth: {ours[0]['arm_swing_deg']:.0f} and {ours[1]['arm_swing_deg']:.0f} deg,"
        f" {100 * ours[0]['com_oscillation']:.1f} and {100 * ours[1]['com_oscillation']:.1f} cm)."
    )


def path(numbers: Numbers) -> str:
    return (
        "; ".join(
            f"`{m['model']}`: {m['path_length']:.1f} m in {m['path_time']:g} s, {m['strides']} strides, lean up to"
            f" {m['max_lean_deg']:.0f} deg, planted feet move {1000 * m['foot_slide_max']:.2f} mm at most"
            for m in (numbers["fig_5_6"], numbers["fig_5_6_smooth"])
        )
        + "."
    )


def convergence(numbers: Numbers) -> str:
    parts = []
    for name, words in (
        ("fig_5_7", "model=thesis"),
        ("fig_5_7_joined", "model.knee=joined"),
        ("fig_5_7_smooth", "model=smooth"),
    ):
        rows = numbers[name]["rows"]
        by_search: dict[str, list[float]] = {}
        for row in rows:
            by_search.setdefault(row["search"], []).append(float(row["cost"]))
        found = ", ".join(
            f"{search} {median(costs):.4f} ({min(costs):.4f} to {max(costs):.4f})"
            for search, costs in sorted(by_search.items(), key=lambda item: median(item[1]))
        )
        seeds = max(len(costs) for costs in by_search.values())
        parts.append(f"`{words}`, final value, median of {seeds} seeds and range: {found}")
    return "; ".join(parts) + "."


def gains(numbers: Numbers) -> str:
    parts = []
    for name in ("eta", "eta_smooth"):
        rows = numbers[name]["rows"]
        for text, common in (("seven gains", False), ("one common gain", True)):
            own = [row for row in rows if ("common_eta" in row["genes"]) == common]
            evals, costs = ([float(row[key]) for row in own] for key in ("eval", "cost"))
            parts.append(
                f"`{rows[0]['model']}`, {text}: eval {median(evals):.4f}, whole cost {median(costs):.4f} (medians of"
                f" {len(own)} seeds)"
            )
    return "; ".join(parts) + "."
