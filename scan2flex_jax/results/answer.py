"""The opening lines of a result: rounded estimates and relative intervals, sensitivities, error on unseen poses, and belief.

A `Fit` and an `Explanation` have one `Answer` each; the summary and the report open with it. The sensitivities to length and
mass are those of `results.influence`. A value has as many digits as its interval resolves (`digits_of`).
"""

import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.posterior.estimate import two_digits
from scan2flex_jax.results.influence import STATED, Influence
from scan2flex_jax.study.check import NO_VALIDATE, study_warnings
from scan2flex_jax.study.model import Study

GOOD, FAIR, BAD = "good", "fair", "bad"
UNBELIEVED = "(no interval: not reliable)"
SYMBOLS = {
    "bending_stiffness": "EI", "torsional_stiffness": "GJ", "axial_stiffness": "EA", "shear_stiffness": "GA",
    "length_density": "rho A", "length": "L",
}  # fmt: skip
_WORDS = {"length": "length", "length_density": "mass"}
_MOST = 6  # largest number of entries of an estimate in the answer: a field along the cable is only in the details
EXPLAIN = "; `scan2flex explain` looks for what is missing"
_WIDTH = 116  # columns of the answer on a terminal
_LINEAR = 10.0  # factor beyond which a formula of first order says nothing
_IDLE = 1e-2  # relative change of an estimate for one of a stated value, below which nothing rests on it
_MOSTLY = 0.5  # of an interval: exact clamps would leave less
_SAME = 0.05  # relative difference of sensitivities that are reported as one


@dataclass(frozen=True)
class Row:
    """One estimate in words: its ``name`` in the format, ``symbol``, ``value`` with unit, 95 % ``interval`` relative to it, and
    a ``note``. ``value`` and ``interval`` are empty if the poses do not determine it; an answer that is not reliable has
    no intervals."""

    name: str
    symbol: str
    value: str
    interval: str
    note: str = ""


@dataclass(frozen=True)
class Answer:
    """``rows`` of the estimates, the stated values they ``rest`` on with sensitivities, the error on ``unseen`` poses, whether
    it is reliable (``belief``, with its ``tone``: good, fair or bad), the ``warnings`` of `check`, and further ``doubts``."""

    rows: tuple[Row, ...]
    rest: str
    unseen: str
    belief: str
    tone: str
    warnings: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """In plain text; a doubt comes before any value."""
        wide = max((len(row.symbol) for row in self.rows), default=0)
        values = max((len(row.value) for row in self.rows), default=0)
        spans = max((len(row.interval) for row in self.rows), default=0)
        rows = [f"  {r.symbol:<{wide}}  {r.value:<{values}}  {r.interval:<{spans}}  {r.note}".rstrip() for r in self.rows]
        belief = [("reliable?", self.belief), *(("", doubt) for doubt in self.doubts)]
        first, last = ([], belief) if self.tone == GOOD else (belief, [])
        said = [("rests on", self.rest), ("unseen poses", self.unseen), *last]
        said += [("check" if i == 0 else "", f"- {warning}") for i, warning in enumerate(self.warnings)]
        return [*_wrapped(first), *rows, *_wrapped(said)]


def _wrapped(said) -> list[str]:
    """Lines of labels with their texts."""
    out = []
    for label, text in said:
        out += textwrap.wrap(text, _WIDTH, initial_indent=f"  {label:<14}", subsequent_indent=" " * 16, break_on_hyphens=False)
    return out


def rows_of(study: Study, estimates: Mapping) -> tuple[Row, ...]:
    """One row for each number of the estimates (`posterior.estimate.Estimate` by name), stiffnesses first."""
    order = sorted(estimates, key=lambda name: list(SYMBOLS).index(name) if name in SYMBOLS else len(SYMBOLS))
    return tuple(row for name in order for row in _rows(study, name, estimates[name]))


def _rows(study, name, e):
    values = np.ravel(e.value)
    if len(values) > _MOST:
        return
    low, high = (np.full(len(values), np.nan) if x is None else np.ravel(x) for x in (e.low, e.high))
    unit = "" if e.unit == "-" else f" {e.unit}"
    for i, v in enumerate(values):
        symbol, stated = symbol_of(name, i if np.ndim(e.value) else None), study.cable.get(name)
        notes = [change_in_words(v, float(np.max(stated)))] if name == "length" and stated is not None else []
        notes += ["at a bound of its range: widen the range, or question the model"] if e.at_bound else []
        if e.identifiable and e.low is None:
            yield Row(name, symbol, f"{number(v, 3)}{unit}", UNBELIEVED, "; ".join(notes))
            continue
        if not (e.identifiable and np.isfinite(low[i]) and np.isfinite(high[i])):
            yield Row(name, symbol, "", "", "; ".join(["not determined by these poses", *notes]))
            continue
        digits = digits_of(v, low[i], high[i])
        interval = f"({number(low[i], 3)} to {number(high[i], 3)})"
        if low[i] * high[i] > 0:  # no relative interval for a value that may be zero
            interval = f"({percent(low[i] / v - 1)} {percent(high[i] / v - 1)})"
        yield Row(name, symbol, f"{number(v, digits)}{unit}", interval, "; ".join(notes))


def symbol_of(name: str, entry: int | None = None) -> str:
    """The symbol of a quantity, with the number of the entry if there are several: EI, EI1, EI2; anchor[0] (tether)."""
    if name in SYMBOLS:
        return SYMBOLS[name] + ("" if entry is None else f"{entry + 1}")
    kind, _, parameter = name.replace("_", " ").replace("[", " ").replace("]", "").rpartition(".")
    return parameter + ("" if entry is None else f"[{entry}]") + (f" ({kind})" if kind else "")


def change_in_words(value: float, stated: float) -> str:
    """The change of a value from the stated one: ``+0.12 mm from the stated 1.2 m``."""
    return f"{number(1e3 * (value - stated), 2, sign=True)} mm from the stated {stated:g} m"


def digits_of(value: float, low: float, high: float, least: int = 3) -> int:
    """Significant digits that resolve an interval: one digit of its width, ``least`` to nine in all."""
    width = abs(high - low)
    if not (np.isfinite(width) and width > 0 and value):
        return least
    return int(np.clip(1 + np.ceil(np.log10(abs(value) / width)), least, 9))


def number(value: float, digits: int, sign: bool = False) -> str:
    """``value`` with ``digits`` significant digits, trailing zeros included, and optionally its sign."""
    text = f"{value:{'+' if sign else ''}#.{digits}g}"
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa.rstrip('.')}{e}{exponent}"


def percent(share: float) -> str:
    """A relative change in per cent, to two digits and with its sign."""
    if not np.isfinite(share):
        return "unknown"
    return f"{two_digits(100.0 * share, sign=True)} %"


def in_mm(metres: float) -> str:
    """Text in millimetres: three decimals from 1 mm on, three significant digits below."""
    return f"{1e3 * metres:.3f}" if metres >= 1e-3 or not metres else number(1e3 * metres, 3)


def noise_in_words(noise: Noise, length: float) -> str:
    """The noise of one coordinate, as a study states it, in millimetres; ``length`` (m) is that of the cable."""
    over = f"{1e3 * noise.correlation_length:.0f} mm, in each coordinate"
    said = f"white {in_mm(noise.white)} mm, correlated {in_mm(noise.correlated)} mm over {over}"
    return f"{said}; the least that is assumed: the shapes show less" if noise.assumed(length) else said


def rests_on(study: Study, influence: Influence | None, lost: Collection[str] = ()) -> str:
    """Length and mass that matter, with their tolerances, and the change of the estimates per cent of each, except those
    ``lost`` (symbols), which the poses do not determine."""
    heavy = any(np.any(study.gravity_in(pose)) for pose in study.poses)  # else the mass is without influence
    names = [name for name in STATED if (heavy or name != "length_density") and not _idle(name, influence, lost)]
    parts = [part for part in (_stated(study, name) for name in names) if part]
    moved = [_sensitivity(study, name, influence, lost) for name in names[::-1]] if influence is not None else []
    said = " and ".join(parts) or "neither a stated length nor a stated mass"
    return ": ".join([said, *filter(None, ["; ".join(filter(None, moved))])]) + _on_clamps(study, influence, lost)


def _on_clamps(study, influence, lost):
    """By how much exact clamps would narrow the intervals, where their tolerance makes most of them."""
    if influence is None or influence.exact_clamps is None:
        return ""
    shares = dict(zip(map(_label, influence.labels), influence.exact_clamps, strict=True))
    less = [f"{two_digits(100 * x)} % of the interval of {n}" for n, x in shares.items() if x < _MOSTLY and n not in lost]
    stated = f"{two_digits(np.degrees(study.tolerance.clamp_rotation))} degrees, {1e3 * study.tolerance.clamp_position:.2g} mm"
    return f"; clamps are fitted within their tolerance ({stated}): exact ones would leave {' and '.join(less)}" if less else ""


def _stated(study, name):
    value, tolerance = study.known(name), getattr(study.tolerance, name)
    if value is None:
        return _elsewhere(study, name)
    value, length = float(np.max(value)), study.known("length")
    said = f"{_WORDS[name]} {value:.4g} m"
    if name == "length_density":
        said = f"mass per metre {value:.4g} kg/m" if length is None else f"mass {value * float(np.max(length)):.4g} kg"
    known = f"+- {100 * tolerance / value:.2g} %, which is in the intervals" if tolerance else "taken as exact"
    return f"{said} ({known})"


def _elsewhere(study, name):
    """A stated prior of an unknown length or mass per length."""
    unknown = next((u for u in study.unknowns if u.name == name), None)
    if unknown is None or unknown.prior is None:
        return ""
    mean, std = (float(np.max(unknown.prior[k])) for k in ("mean", "std"))
    what = "length" if name == "length" else "mass per metre"
    return f"{what} measured as {mean:.4g} +- {100 * std / mean:.2g} % (which is in the intervals)"


def _sensitivity(study, name, influence, lost):
    """``1 % of mass is 1 % of EI and GJ``."""
    groups: list[tuple[list[str], float]] = []
    for symbol, s in _moved(name, influence, lost):
        near = next((names for names, own in groups if abs(own - s) < _SAME * max(abs(own), abs(s), 0.1)), None)
        if near is None:
            groups.append(([symbol], s))
        else:
            near.append(symbol)
    if not groups:
        return ""
    of = " (at this mass per metre)" if name == "length" and study.known("length_density") is not None else ""
    return f"1 % of {_WORDS[name]}{of} is " + ", ".join(f"{two_digits(s)} % of {' and '.join(names)}" for names, s in groups)


def _moved(name, influence, lost):
    """Symbols of the estimates with their relative change for one of a stated value."""
    changes = zip(influence.labels, influence.stated.get(name, ()), influence.logs, strict=False)
    kept = [(_label(label), float(s)) for label, s, log in changes if log and np.isfinite(s) and "." not in label]
    return [(symbol, s) for symbol, s in kept if symbol not in lost]


def _idle(name, influence, lost):
    """Whether a stated value changes no estimate."""
    moved = [] if influence is None else _moved(name, influence, lost)
    return bool(moved) and all(abs(s) < _IDLE for _, s in moved)


def _label(label: str) -> str:
    name, bracket, entry = label.partition("[")
    return symbol_of(name, int(entry.rstrip("]")) if bracket else None)


def distance_in_words(rms: float, length: float) -> str:
    """``0.43 mm RMS (0.036 % of the length)``."""
    return f"{1e3 * rms:.3g} mm RMS ({percent(rms / length).lstrip('+')} of the length)"


def warnings_of(study: Study) -> tuple[str, ...]:
    """The warnings of `check`, without the one that the belief repeats."""
    return tuple(w for w in study_warnings(study) if w != NO_VALIDATE)


def moved_in_words(influence: Influence | None, pose: str) -> str:
    """Change of the stiffnesses when a pose is left out: ``EI -0.3 %, GJ +1.2 %``; empty for a pose that was not fitted."""
    if influence is None or len(influence.poses) < 2:
        return ""
    changes, said = influence.of_pose(pose), []
    for (label, change), log in zip(changes.items(), influence.logs, strict=False):
        if log and "." not in label:
            said.append(f"{_label(label)} {percent(change) if 1.0 / _LINEAR < 1.0 + change < _LINEAR else 'not determined'}")
    return ", ".join(said)


def answer_of(fit) -> Answer:
    """The answer of a `Fit`."""
    doubts = () if fit.mistakes else fit.doubts
    said = reliability(fit.faults, fit.reasons_for_care, f"yes: {fit.judgement}")
    return compose(fit.study, fit.estimates, fit.influence, _unseen(fit), *said, doubts)


def reliability(faults: Sequence[str], doubts: Sequence[str], yes: str) -> tuple[str, str]:
    """Tone and sentence on whether an answer is reliable: no by its first fault, with care by its first doubt, else ``yes``."""
    if faults:
        return BAD, f"no: {faults[0]}"
    return (FAIR, f"with care: {doubts[0]}") if doubts else (GOOD, yes)


def compose(
    study: Study,
    estimates: Mapping,
    influence: Influence | None,
    unseen: str,
    tone: str,
    belief: str,
    doubts: tuple[str, ...] = (),
) -> Answer:
    """An answer; the belief names undetermined estimates, and neither doubts nor warnings repeat a sentence before them."""
    rows = rows_of(study, estimates)
    lost = [row.symbol for row in rows if not row.value]
    belief += f"; these poses do not determine {' and '.join(lost)}" if lost and tone != BAD else ""
    doubts = tuple(d for d in doubts if d not in belief)
    warnings = tuple(w for w in warnings_of(study) if w not in doubts)
    return Answer(rows, rests_on(study, influence, lost), unseen, belief, tone, warnings, doubts)


def unseen_in_words(rms: float, poses: int, left_out: float | None, fitted: int, length: float, before: str = "") -> str:
    """The error (m) on so many validate ``poses``, with that ``before``; without them, on so many ``fitted`` poses left out in
    turn."""
    if poses and np.isfinite(rms):
        return f"{distance_in_words(rms, length)}{before} in {poses} held-out pose{'s' * (poses > 1)}"
    if poses:
        return "not known: a validate pose could not be solved"
    if fitted < 2:
        return "not known: there is one pose only"
    if left_out is None or not np.isfinite(left_out):
        return "not known: a pose left out in turn is not predicted by the others"
    return f"{distance_in_words(left_out, length)} in poses left out in turn, to first order"


def _unseen(fit):
    """The error on unseen poses."""
    fitted = [len(p.residual) for p in fit.poses.values() if p.role == "fit"]
    left_out = None if fit.influence is None else fit.influence.rms(fitted)
    unseen = len(fit.poses) - len(fitted)
    alone = readings_in_words(fit.poses.values())
    return alone or unseen_in_words(fit.rms("validate"), unseen, left_out, len(fitted), fit.problem.length)


def readings_in_words(poses: Iterable[Any]) -> str:
    """The error on held-out poses where these, or without any the fitted ones, show no points; empty elsewhere."""
    poses = list(poses)
    unseen = [p for p in poses if p.role == "validate"]
    if any(len(p.residual) for p in unseen or poses) or not all(p.stable for p in unseen):
        return ""
    if not unseen:
        return "not known: the poses have no points, but other readings; leave one out as a validate pose"
    worst = max(one.off for p in unseen for one in p.readings)
    count = f"{len(unseen)} held-out pose{'s' * (len(unseen) > 1)}"
    return f"readings off by up to {worst:.2g} times their noise in {count}"
