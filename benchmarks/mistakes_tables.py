"""The table of docs/mistakes.md: deliberate mistakes and the step that names each. See `benchmarks.tables`."""

from pathlib import Path

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[1] / "docs" / "mistakes.md"


def mistakes() -> str:
    """Every kind of mistake on every study, and the studies without one."""
    entry = load("mistakes")
    r = entry["results"]
    cases, t = r["cases"], r["table"]
    kinds = dict.fromkeys(kind for study in cases.values() for kind in study)
    rows = [[kind, *(_cell(study.get(kind)) for study in cases.values())] for kind in kinds]
    traced = t["made"] - t["without trace"]
    said = f"\n{t['kinds']} kinds, {t['made']} studies with a mistake: {t['without trace']} without a trace in the shapes. "
    said += f"Of the other {traced}, {t['named']} are named with the right mend ({100 * t['named'] / max(1, traced):.0f} %), "
    said += f"{t['warned']} warned of, {t['missed']} missed.\n\n"
    silent = t["intervals without a warning that exclude the truth, with a trace"]
    said += f"Intervals that leave out the truth without a warning in the first three lines: {silent} with a trace, "
    said += f"{t['the same without a trace']} without. Physics named over a mistake: {t['physics named']}.\n\n"
    accused = ", ".join(t["accused"]) or "none"
    said += f"Studies without a mistake: {t['without a mistake']}; accused of one: {accused}.\n"
    return table(["mistake", *cases], rows) + said + made_on(entry)


def _cell(case) -> str:
    """What was said of one study, and by whom; a dash where the mistake cannot be made."""
    if case is None:
        return "-"
    by = {"refusal": "refused", "check": "`check`", "fit": "`fit`"}.get(case.get("by") or "")
    return by if case["outcome"] == "named" and by else case["outcome"]


TABLES = {"mistakes": mistakes}
