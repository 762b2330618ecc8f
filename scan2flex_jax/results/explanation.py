"""Results of `explain`: the table of hypotheses, the verdict, the format's JSON, and the study with the effects declared."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from scan2flex_jax.fitting.discrepancy import Discrepancy
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.posterior import belief
from scan2flex_jax.posterior.decision import NAMED, PARTLY, TIED, TOO_LITTLE, UNEXPLAINED, UNSOLVED, Decision
from scan2flex_jax.posterior.estimate import NORMAL_95, Estimate, two_digits
from scan2flex_jax.posterior.law import Law
from scan2flex_jax.posterior.loops import Loop
from scan2flex_jax.posterior.posterior import Fitted
from scan2flex_jax.posterior.quantities import Field
from scan2flex_jax.posterior.settings import USUAL, Settings
from scan2flex_jax.results.along import StiffnessAlong
from scan2flex_jax.results.answer import (
    Answer,
    change_in_words,
    digits_of,
    in_mm,
    moved_in_words,
    noise_in_words,
    number,
    percent,
)
from scan2flex_jax.results.fit_result import Fit, PoseFit, in_words, rms_over
from scan2flex_jax.results.influence import Influence, influence_of
from scan2flex_jax.results.words import answer_of, faults_of
from scan2flex_jax.study.kinds import kind_format, kind_names
from scan2flex_jax.study.mistakes import Mistake
from scan2flex_jax.study.model import Study

_ROWS = 8  # hypotheses in the summary
_FEW = 6  # numbers of a parameter that a line tells, of two ends and three axes
_TELLING = 10.0  # times the parameter: an interval of a larger standard error is not printed


@dataclass(frozen=True)
class Hypothesis:
    """One row of the table: effect types (none: the model without effects) in a ``variant`` of the study.

    ``log_evidence`` (nats) over the model without effects; ``elpd`` (nats), the log density of each pose predicted from the
    others, summed, over the same, with its paired standard error ``elpd_std``; ``relation`` to the best: "best", "tied",
    "simpler", "wider" or "less likely".
    """

    kinds: tuple[str, ...]
    variant: str
    log_evidence: float
    elpd: float
    elpd_std: float
    relation: str

    @property
    def name(self) -> str:
        """In words."""
        return " + ".join(k.replace("_", " ") for k in self.kinds) or "no effect"

    def to_json(self) -> dict:
        """As in the study format."""
        figures = {k: float(v) for k in ("log_evidence", "elpd", "elpd_std") if np.isfinite(v := getattr(self, k))}
        return {"kinds": list(self.kinds), "variant": self.variant, "relation": self.relation} | figures


@dataclass(frozen=True)
class Ranked:
    """One effect type: its parameters, evidence and verdict; RMS in m if it was refitted.

    ``log_evidence`` (nats): of the likeliest hypothesis with this effect alone over the one without effects; of an effect
    chosen with others, that of all of them together. ``p_value``: probability that nothing is missing, against it alone.
    """

    kind: str
    parameters: dict[str, float | np.ndarray]
    log_evidence: float
    p_value: float
    verdict: str
    tied_with: tuple[str, ...] = ()
    rms_fit: float | None = None
    rms_validate: float | None = None
    std: dict[str, float | np.ndarray] = field(default_factory=dict)

    def in_short(self) -> dict:
        """The effect alone: kind, parameters and, where known, their standard errors."""
        return {"kind": self.kind, "parameters": _plain(self.parameters)} | ({"std": _plain(self.std)} if self.std else {})

    def to_json(self) -> dict:
        """As in the study format."""
        out = {"kind": self.kind, "parameters": _plain(self.parameters), "log_evidence": float(self.log_evidence)}
        out |= {"p_value": float(self.p_value)}
        out |= {k: float(v) for k in ("rms_fit", "rms_validate") if (v := getattr(self, k)) is not None and np.isfinite(v)}
        out |= {"std": _plain(self.std)} if self.std else {}
        return out | {"verdict": self.verdict, "tied_with": list(self.tied_with)}


@dataclass(frozen=True, kw_only=True)
class PoseChange(PoseFit):
    """One pose after, and ``before``: RMS distances (m) and residuals.

    ``left_out``: RMS distance (m) of the prediction from the other fitted poses (None for validate poses).
    """

    rms_before: float
    residual_before: np.ndarray = field(repr=False)
    left_out_before: float | None = None
    left_out: float | None = None

    def to_json(self) -> dict:
        """As in the study format."""
        more = {k: getattr(self, k) for k in ("rms_before", "left_out_before", "left_out")}
        return super().to_json() | {k: float(v) for k, v in more.items() if v is not None and np.isfinite(v)}


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Missing physics: verdict, hypotheses, refitted model, and the error before and after.

    ``hypotheses`` is the table of all that were scored, the likeliest first; ``ranking`` holds every effect type; ``chosen``
    the effects found (none, one or several), with their parameters; ``estimates`` are the final ones; ``discrepancy`` is that
    of the poses given the refitted model, ``scatter`` the relative scatter between poses of each size; ``sentences`` are the
    findings in words, ``settle`` the measurements to decide a tie. ``load`` is the equivalent load (N/m) shared by all poses,
    ``pose_loads`` that of each fitted pose: where an effect acts, not which. ``description`` replaces an effect if none
    explains the shapes: a field that is not physics. ``laws``: the moment laws among the effects, with bands and readings.
    ``along``: EI along the cable, where an effect lets it vary. ``loops``: what is read off effects with memory.
    ``study`` has the effects declared; ``decision`` is what the verdict rests on, from which `plan` continues, and ``scored``
    every hypothesis at its mode. ``mistakes``: likely mistakes of the input that stand. ``reservation``: why it is believed
    with care at most. ``surprised``: by the name of each validate pose that contradicts the answer, its distance over the
    expected one. ``record``: the hypotheses as numbers, from which `explain` of the same study continues.

    ``fit``, ``noise`` and dependent fields are None or empty if poses are not solved (verdict "not in equilibrium").
    """

    study: Study = field(repr=False)
    verdict: str
    fit: Fit | None = field(repr=False, default=None)
    p_value: float = 1.0
    noise: Noise | None = None
    discrepancy: Discrepancy | None = None
    scatter: dict[str, float] = field(default_factory=dict)
    hypotheses: tuple[Hypothesis, ...] = ()
    ranking: tuple[Ranked, ...] = ()
    chosen: tuple[Ranked, ...] = ()
    estimates: dict[str, Estimate] = field(default_factory=dict)
    poses: dict[str, PoseChange] = field(default_factory=dict)
    settle: tuple[str, ...] = ()
    sentences: tuple[str, ...] = ()
    gates: dict[str, int | float] = field(default_factory=dict)
    seconds: float = 0.0
    load: Field | None = field(repr=False, default=None)
    pose_loads: tuple[Field, ...] = field(repr=False, default=())
    description: Ranked | None = None
    laws: tuple[Law, ...] = ()
    along: StiffnessAlong | None = None
    loops: tuple[Loop, ...] = ()
    decision: Decision | None = field(repr=False, default=None)
    scored: tuple[Fitted, ...] = field(repr=False, default=())
    mistakes: tuple[Mistake, ...] = ()
    surprised: dict[str, float] = field(default_factory=dict)
    reservation: str = ""
    settings: Settings = USUAL
    record: dict[str, Any] = field(repr=False, default_factory=dict)

    @property
    def misfits(self) -> tuple[str, ...]:
        """Fitted poses that the final model leaves too far from their curves for noise (`posterior.belief.misfits`), in words;
        none where the effects explain most of the error, and more than noise remains by the verdict itself."""
        if self.fit is None or self.verdict == PARTLY:
            return ()
        return belief.misfits(self.fit.study, self.poses, self.fit.problem.length, self.fit.settings)

    @property
    def believable(self) -> bool:
        """Whether the answer is not "no"; otherwise the values are unusable, and have no intervals."""
        return not faults_of(self)

    @property
    def singles(self) -> tuple[Fitted, ...]:
        """Hypotheses of one effect of the catalogue, the likeliest first."""
        return tuple(h for h in self.scored if len(h.kinds) == 1 and not h.components[0].entry.field)

    @property
    def significant(self) -> bool:
        """Whether something is missing from the baseline model."""
        return self.decision is not None and self.decision.missing

    def rms(self, role: str = "fit", after: bool = True) -> float:
        """Root mean square distance (m) over all points of the poses of a role; NaN without such poses."""
        return rms_over((p for p in self.poses.values() if p.role == role), "rms" if after else "rms_before")

    def rms_left_out(self, after: bool = True) -> float:
        """Root mean square distance (m) over the fitted poses, each predicted from the others; NaN with a single one."""
        fitted = [p for p in self.poses.values() if p.role == "fit"]
        return rms_over(fitted, "left_out" if after else "left_out_before") if len(fitted) > 1 else float("nan")

    def shifts(self) -> dict[str, Any]:
        """Change of each estimate over its final standard error; estimates with unknown errors are omitted."""
        if self.fit is None or not self.chosen:
            return {}
        known = {n: e for n, e in self.estimates.items() if e.std is not None and np.all(np.asarray(e.std) > 0)}
        return {n: (np.asarray(e.value) - np.asarray(self.fit.estimates[n].value)) / e.std for n, e in known.items()}

    @cached_property
    def influence(self) -> Influence | None:
        """Sensitivities of the estimates given the effects, to first order; None if the poses are not solved.

        The first access solves the poses twice more.
        """
        return None if self.decision is None else influence_of(self.decision.best)

    @property
    def answer(self) -> Answer:
        """Opening lines of the summary: estimates, their sensitivities, the error on unseen poses, and belief."""
        return answer_of(self)

    def to_json(self) -> dict:
        """The format's result object; its log evidences are over the model without effects, in nats."""
        out: dict[str, Any] = {"format": "scan2flex-result/1", "verdict": self.verdict, "believable": self.believable}
        out |= {"mistakes": [m.to_json() for m in self.mistakes]} if self.mistakes else {}
        if self.noise is None or self.fit is None or self.load is None:
            return out | {"settle": list(self.settle), "messages": list(self.sentences), "seconds": self.seconds}
        before = {name: _plain(e.value) for name, e in self.fit.estimates.items()}
        after = {name: _plain(e.value) for name, e in self.estimates.items()}
        discrepancy = {} if self.discrepancy is None else self.discrepancy.to_json() | {"scatter": _plain(self.scatter)}
        return out | {
            "estimates": {name: e.to_json() for name, e in self.estimates.items()},
            "poses": {name: p.to_json() for name, p in self.poses.items()},
            "noise": self.noise.to_json(),
            "test": {"p_value": float(self.p_value), "significant": self.significant},
            "hypotheses": [h.to_json() for h in self.hypotheses],
            "ranking": [r.to_json() for r in self.ranking],
            "chosen": [r.in_short() for r in self.chosen],
            **({"discrepancy": discrepancy} if discrepancy else {}),
            "before": self._errors(False) | {"estimates": before},
            "after": self._errors(True) | {"estimates": after, "shift_in_std": _plain(self.shifts())},
            "gates": _plain(self.gates),
            "settings": self.settings.to_json(),
            "equivalent_load": self.load.to_json(),
            **({} if self.description is None else {"description": self.description.to_json()}),
            **({"laws": [law.to_json() for law in self.laws]} if self.laws else {}),
            **({} if self.along is None else {"stiffness_along": self.along.to_json()}),
            **({"loops": [loop.to_json() for loop in self.loops]} if self.loops else {}),
            **({"contradicted_by": _finite(self.surprised)} if self.surprised else {}),
            "settle": list(self.settle),
            "messages": list(self.sentences),
            "seconds": float(self.seconds),
        }

    def _errors(self, after):
        values = {f"rms_{role}": self.rms(role, after) for role in ("fit", "validate")}
        values["rms_left_out"] = self.rms_left_out(after)
        return {k: v for k, v in values.items() if np.isfinite(v)}

    @property
    def concluded(self) -> bool:
        """Whether the evidence is meaningful, i.e. the baseline model is solved accurately enough."""
        return self.verdict != UNSOLVED

    def in_words(self, r: Ranked) -> str:
        """The verdict of an effect type in words that stand alone."""
        if r.verdict != TOO_LITTLE:
            return r.verdict
        if self.verdict == UNEXPLAINED:
            first = self.decision.cause if self.decision else None
            return "likeliest, not established" if first is not None and r.kind in first.names else "explains too little"
        return "less likely"

    def summary(self) -> str:
        """The explanation in plain text, about one page: answer, findings, and every estimate and pose."""
        lines = [f"{self.study.title}: {self.verdict}", "", *(f"  {s}" for s in self.sentences if self.mistakes)]
        lines += [*self.answer.lines(), ""]
        lines += [f"  {s}" for s in (*self.sentences, *(self.along.sentences() if self.along else ())) if not self.mistakes]
        if self.noise is None or self.fit is None:
            return "\n".join(lines)
        lines += [""] * bool(self.chosen) + [f"  {_effect_line(r, self.fit.study)}" for r in self.chosen]
        lines += ["", *self._table_lines()] if self.concluded else []
        lines += ["", *self._estimate_lines(), "", *self._pose_lines()]
        lines += ["", f"  noise: {noise_in_words(self.noise, self.fit.problem.length)}"]
        return "\n".join([*lines, *(f"  to settle it: {s}" for s in self.settle)])

    def _table_lines(self):
        yield f"  {'hypothesis':<44}{'elpd':>9}{'s.e.':>7}{'log evidence':>15}   (nats over no effect)"
        for h in self.hypotheses[:_ROWS]:
            name = h.name if h.variant == "as stated" else f"{h.name} ({h.variant})"
            elpd = f"{h.elpd:9.1f}{h.elpd_std:7.1f}" if np.isfinite(h.elpd) else f"{'':16}"
            yield f"  {name[:43]:<44}{elpd}{h.log_evidence:15.1f}   {h.relation}"

    def _estimate_lines(self):
        shifts, before = self.shifts(), {} if self.fit is None else self.fit.estimates
        for name, e in self.estimates.items():
            moved = ", ".join(map(two_digits, np.ravel(shifts.get(name, ()))))
            shift = f"   (moved by {moved} standard errors)" if moved else ""
            yield f"  {name:<24} before  {in_words(before[name])}"
            yield f"  {'':<24} after   {in_words(e)}{shift}"

    def _pose_lines(self):
        moved = {name: moved_in_words(self.influence, name) for name in self.poses}
        without = "   without it" if any(moved.values()) else ""
        yield f"  pose                 role       before mm   after mm   left out: before, after mm{without}"
        yield from (f"{_pose_line(n, p)}   {moved[n]}".rstrip() for n, p in self.poses.items())


def parameter_in_words(study: Study, kind: str, name: str, value, std=None) -> str:
    """A parameter with its unit and, from its standard error, its 95 % interval. A length is given by its change from that
    stated in the ``study``, a factor by its change from 1."""
    if isinstance(value, str):
        return value
    known = std is not None and np.all(np.isfinite(std)) and np.max(std) < _TELLING * max(np.max(np.abs(value)), np.min(std))
    form, stated = kind_format(kind).parameter(name) if kind in kind_names() else None, study.known("length")
    ends = _interval(value, std, "any" if form is None else form.domain) if known else ()
    if name == "length" and stated is not None:
        moved = [number(1e3 * (float(end) - float(np.max(stated))), 2, sign=True) for end in ends]
        return change_in_words(float(value), float(np.max(stated))) + _between(moved)
    if form is not None and (name, form.unit) == ("factor", "-") and np.ndim(value) == 0:
        return percent(float(value) - 1.0) + _between([percent(float(end) - 1.0) for end in ends])
    digits = digits_of(float(value), float(ends[0]), float(ends[1])) if ends and np.ndim(value) == 0 else 4
    unit = "" if form is None or form.unit == "-" else f" {form.unit}"
    return _shown(value, digits) + _between([_shown(end, digits) for end in ends]) + unit


def _between(ends) -> str:
    """The ends of an interval; empty without one."""
    return f" [{', '.join(ends)}]" if ends else ""


def _interval(value, std, domain):
    """The 95 % interval of a parameter, log-normal for a positive one; none that is wider than such a logarithm tells."""
    value, half = np.asarray(value, float), NORMAL_95 * np.asarray(std, float)
    if domain == "positive" and np.all(value > 0.0):
        return (value * np.exp(-half / value), value * np.exp(half / value)) if np.max(half / value) < _TELLING else ()
    return (np.maximum(value - half, 0.0) if domain in ("nonnegative", "along_cable") else value - half), value + half


def _effect_line(r, study):
    """``point_mass: position 0.42 [0.40, 0.44] m, mass 0.05 [0.046, 0.054] kg``; of a field without its values at places, which
    the JSON has."""
    given = {name: value for name, value in r.parameters.items() if np.size(value) <= _FEW}
    said = [f"{name} {parameter_in_words(study, r.kind, name, value, r.std.get(name))}" for name, value in given.items()]
    return f"{r.kind}: {', '.join(said)}"


def _pose_line(name, p):
    line, more = f"  {name:<20} {p.role:<9}", "".join(f"\n    {one.sentence()}" for one in p.readings)
    if not len(p.residual):
        return line + more
    line += f"{in_mm(p.rms_before):>11}{in_mm(p.rms):>11}"
    return (line if p.left_out is None else f"{line}{in_mm(p.left_out_before):>19}{in_mm(p.left_out):>11}") + more


def _shown(value, digits=4):
    if np.ndim(value) == 0:
        return f"{float(value):.{digits}g}"
    zero = 1e-9 * np.max(np.abs(value))  # rounding errors
    return f"({', '.join(f'{0.0 if abs(v) < zero else v:.3g}' for v in np.ravel(value))})"


def _finite(values):
    """Numbers that JSON knows; None for an infinite one."""
    return {k: float(v) if np.isfinite(v) else None for k, v in values.items()}


def _plain(value):
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if np.ndim(value) == 0:
        return value if isinstance(value, str | bool) or value is None else float(value)
    return np.asarray(value).tolist()


__all__ = ["NAMED", "TIED", "Explanation", "Hypothesis", "PoseChange", "Ranked", "parameter_in_words", "rms_over"]
