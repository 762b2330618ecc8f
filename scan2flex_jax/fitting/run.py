"""The fit of a study: from measured curves to estimates with intervals, in a few steps that each have their module.

Start (the user's guess, and one from the balance equations), minimise, estimate the noise from what is left, fit again with
the priors that the noise gives their weight, and judge: intervals, what is open, and the poses that had no part in it.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import branches
from scan2flex_jax.fitting.direct import Direct, measured_by
from scan2flex_jax.fitting.evaluate import Evaluator
from scan2flex_jax.fitting.least_squares import Goal, bfgs, levenberg_marquardt, nelder_mead
from scan2flex_jax.fitting.parameters import layout_of, start_vector, template, values_of
from scan2flex_jax.fitting.poses import poses_of
from scan2flex_jax.fitting.result import Estimate, Fit, PoseFit, unit_of
from scan2flex_jax.fitting.start import balance_start
from scan2flex_jax.fitting.states import DISTANCES
from scan2flex_jax.fitting.statistics import noise_of, uncertainty, unseen_spread
from scan2flex_jax.statics.solve import SENTENCES
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.sense import check_study

METHODS = ("least-squares", "bfgs", "nelder-mead")
DATA = ("auto", "curve", "cloud")
_STIFF = ("bending_stiffness", "torsional_stiffness")
FIT_ELEMENTS = 40  # fourth order: 1e-6 of the length on the poses of the tests
_NORMAL_95 = 1.959964
_SAYABLE = 5.0  # standard deviation of a logarithm beyond which an interval is no information
_PREDICTED = 1.5  # validate RMS over the fitted poses' noise that still counts as prediction to within the noise
_FELT = 0.3  # of the noise: what tolerances and the estimates' errors do to a validate pose is spoken of beyond it
_SLOW, _LONG = 3.0, 0.2  # correlated over white noise, and correlation over cable length, of a residual that is no noise
_MESH = 5.0e-5  # of the length: a residual this small may be the mesh's
_CREDIBLE = 0.01  # of the length: RMS of a minimum beyond which another start is tried too
_WEAK = 3.0  # standard deviation of a logarithm about where a fit begins: a factor of 20
_LADDER = (1.0, 0.1, 10.0, 0.01, 100.0)  # factors on the start, tried in turn until every pose can be solved


@threadpool_limits.wrap(limits=1, user_api="blas")  # matrices of some 70 rows: threads cost more than they bring
def fit(
    study: Study,
    method: str = "least-squares",
    *,
    data: str = "auto",
    distance: str = "normal",
    elements: int = FIT_ELEMENTS,
    progress: Callable[[str], None] | None = None,
    slots: tuple = (),
) -> Fit:
    """Estimate the unknowns of ``study`` from the shapes of its ``fit`` poses (paper, Section 5.2, Eq. 9).

    ``method``: "least-squares" (Levenberg-Marquardt with the implicit Jacobian), "bfgs" (on the summed squared distance)
    or "nelder-mead" (the paper's). ``data``: "curve" fits centre curves (extracted first where a pose has a scan only),
    "cloud" the points of the scans themselves, "auto" curves where every pose has one or a scan is too coarse for its
    cable, else clouds. ``distance``, of curves: "normal", "integrated" (the paper's Eq. 10), or "hausdorff" (for "bfgs" and
    "nelder-mead": it has no least squares). ``progress`` is called with a line of text now and then. ``slots``: energy laws
    of effects that may be added later, at zero amplitude, so that what is compiled here serves then too. Raises
    `Scan2FlexError` when there is nothing to fit or no pose can be solved.
    """
    _check(study, method, distance, data)
    began = time.perf_counter()
    progress = progress or (lambda message: None)
    whole, scans, said = measured_by(study, data, method, distance, progress)
    problem = Problem(whole, elements, distance, progress, slots)
    minimum = problem.minimise(method)
    problem, minimum = _on_its_branches(problem, minimum, method)
    turned, whole = branches.sentences(whole, problem.study), problem.study
    study = branches.with_turns(study, {p.name: p.turns for p in whole.poses})
    if distance == "hausdorff":
        minimum, said = problem.seen_by_normals(minimum), (*said, _HAUSDORFF)
    stated = _stated_noise(study)
    if scans is None:
        minimum, noise, known = _from_curves(problem, minimum, stated)
        poses, solved = _pose_fits(problem, minimum, known.covariance), problem.evaluator.equilibria
    else:
        direct = Direct(problem, scans)
        minimum, noise, known = direct.fit(minimum)
        poses, solved = direct.pose_fits(minimum), direct.equilibria
        said = (*said, *direct.sentences())
    valid, verdict = _validity(poses, noise, stated, problem.length)
    estimates = _estimates(problem.layout, minimum.shared, known)
    said = said if minimum.converged else (*said, _UNSETTLED)
    sentences = (*said, *turned, *known.sentences, *_bound_sentences(estimates), *verdict)
    spread = np.sqrt(np.diag(known.covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = known.covariance / np.outer(spread, spread)
    np.fill_diagonal(correlation, 1.0)
    return Fit(
        study if scans else whole,
        method,
        distance,
        estimates,
        problem.layout.labels,
        correlation,
        poses,
        noise,
        sentences,
        valid,
        minimum.converged,
        solved,
        time.perf_counter() - began,
        minimum.cost,
        (problem, minimum),
        "curve" if scans is None else "cloud",
        turned,
    )


def _on_its_branches(problem, minimum, method):
    """The problem and its minimum with every pose, validate poses too, a full turn off where that is what was measured."""
    while True:
        own = branches.distances(minimum.evaluation, problem.poses.mask) / problem.length
        vectors = [minimum.shared]
        if np.any(own > branches.ASTRAY):
            vectors += [np.r_[x, minimum.shared[len(x) :]] for x in problem.starts()]
        turns = []
        for x in vectors:  # all poses that are nearer with other turns, and each of them alone
            nearer = branches.nearest(problem, problem.study.fit_poses, own > branches.FAR, x)
            turns += [nearer, *({name: n} for name, n in nearer.items())]
        found = []
        for other in (t for i, t in enumerate(turns) if t and t not in turns[:i]):
            tried = problem.with_study(branches.with_turns(problem.study, other))
            with suppress(Scan2FlexError):  # nothing settles with these turns
                found.append((tried, tried.minimise(method, branches.BETTER * minimum.cost)))
            problem.evaluator.equilibria = tried.evaluator.equilibria
        best = min(found, key=lambda pair: pair[1].cost, default=None)
        if best is None or best[1].cost > branches.BETTER * minimum.cost:
            break
        problem, minimum = best
    if unseen := problem.study.validate_poses:
        own = branches.distances(problem.predicted(minimum), problem.held_out.mask) / problem.length
        seen = branches.nearest(problem, unseen, own > branches.FAR, minimum.shared, branches.BETTER)
        problem.hold_out(branches.with_turns(problem.study, seen))
    return problem, minimum


def _from_curves(problem, minimum, stated):
    """The minimum under its priors, the noise of the curves, and what is known of the estimates."""
    noise = noise_of(minimum.evaluation, problem.poses, problem.layout, problem.length, stated)
    if problem.layout.shared > problem.layout.unknowns or problem.layout.local:
        minimum = problem.with_priors(minimum, noise)
        noise = noise_of(minimum.evaluation, problem.poses, problem.layout, problem.length, stated)
    return minimum, noise, uncertainty(minimum, problem.poses, problem.layout, problem.scale(noise), noise)


_UNSETTLED = "the fit has not settled within its iterations: its values and intervals are not to be believed"
_HAUSDORFF = "fitted to the largest distance of each pose: the intervals are those of a least-squares fit at these values"


class Problem:
    """One study made ready: layout, template, poses and evaluator; kept by the loop that refits with effects added."""

    def __init__(self, study, elements=FIT_ELEMENTS, distance="normal", progress=lambda message: None, slots=()):
        """Arrays of the fit poses; nothing is solved yet."""
        self.study, self.elements, self.progress, self.slots = study, elements, progress, slots
        self.layout, self.template = layout_of(study), template(study)
        guess = study.start_value("length") or 1.0
        self.length = float(study.cable.get("length", guess))
        self.poses = poses_of(study.fit_poses, self.length, elements)
        self.held_out = _held_out(study, self.length, elements)
        self.evaluator = self.evaluator_of(self.poses, distance)

    def evaluator_of(self, poses, distance: str = "normal") -> Evaluator:
        """An evaluator of other poses, that has counted nothing yet."""
        return Evaluator(self.layout, self.template, poses, self.elements, distance, self.slots)

    def with_study(self, study) -> "Problem":
        """The same of another study with the same unknowns; equilibria are counted on."""
        other = Problem(study, self.elements, self.evaluator.distance, self.progress, self.slots)
        other.evaluator.equilibria = self.evaluator.equilibria
        return other

    def hold_out(self, study) -> None:
        """Take over a study that differs in its ``validate`` poses only."""
        self.study, self.held_out = study, _held_out(study, self.length, self.elements)

    def predicted(self, minimum):
        """The evaluation of the ``validate`` poses, which had no part in the minimum."""
        return self.evaluator_of(self.held_out, self.evaluator.distance)(minimum.shared)

    def scale(self, noise) -> np.ndarray:
        """Standard deviation (m) that weighs each pose: the stated one, else the estimated one."""
        return np.array([noise.total if pose.noise is None else pose.noise for pose in self.study.fit_poses])

    def goal(self, sigma) -> Goal:
        """What is minimised, with residuals in units of ``sigma`` (m) per pose."""
        prior = self.layout.shared - self.layout.unknowns
        low = np.r_[[v for s in self.layout.slots for v in s.low], np.full(prior, -np.inf)]
        high = np.r_[[v for s in self.layout.slots for v in s.high], np.full(prior, np.inf)]
        return Goal(self.evaluator, sigma, low, high, self.progress, np.where(self._logs(), _WEAK**-2, 0.0))

    def starts(self) -> list[np.ndarray]:
        """Start vectors of the unknowns: the user's guess where given, and the package's own."""
        known = {n: float(np.mean(self.study.known(n))) for n in _STIFF if self.study.known(n) is not None}
        values = {**self.study.cable, **{u.name: self.study.start_value(u.name) for u in self.study.unknowns}}
        density = float(values.get("length_density") or 1.0)
        own = balance_start(self.poses, density * np.asarray(self.study.gravity), self.length, known)
        guessed = start_vector(self.study, self.layout, own)
        free = start_vector(_without_guesses(self.study), self.layout, own)
        return [guessed] if np.allclose(guessed, free, atol=0.05) else [guessed, free]

    def minimise(self, method: str, beat: float = np.inf):
        """The minimum from the start that fits better, and from the other one too where that leaves doubt.

        The slower methods use the first start only. Numbers with priors do not move yet. Of use is only a minimum below
        ``beat``: what stays far above it is not followed to its end.
        """
        sigma = np.full(self.poses.count, 1e-3 * self.length)
        stated = [p.noise for p in self.study.fit_poses]
        if all(stated):
            sigma = np.array(stated, float)
        goal = replace(self.goal(sigma), beat=beat)
        prior = np.zeros(self.layout.shared - self.layout.unknowns)
        if method != "least-squares":
            run = {"bfgs": bfgs, "nelder-mead": nelder_mead}[method]
            return self._finite(run(goal, np.r_[self.starts()[0], prior]))
        local = np.zeros((self.poses.count, self.layout.local))
        begun = [(x, self.evaluator(x, local)) for x in (np.r_[x, prior] for x in self.starts())]
        begun.sort(key=lambda start: goal.cost(start[1], start[0], local))
        found = []
        for x, evaluation in begun:
            found.append(self._descend(goal, x, evaluation))
            if self._beyond_doubt(found[-1], goal):
                break
        return self._finite(min(found, key=lambda m: m.cost))

    def _beyond_doubt(self, minimum, goal):
        """Whether a minimum needs no second start: converged, at no bound, and the shapes are those that were measured."""
        inside = np.all((minimum.shared > goal.low) & (minimum.shared < goal.high))
        own = np.asarray(self.poses.mask).sum()
        rms = np.sqrt(np.sum(minimum.evaluation.residual**2) / own)
        return bool(minimum.converged and inside and rms < _CREDIBLE * self.length)

    def _logs(self) -> np.ndarray:
        """Which of the shared numbers are logarithms."""
        known = [False] * (self.layout.shared - self.layout.unknowns)
        return np.array([s.log for s in self.layout.slots for _ in range(s.size)] + known, bool)

    def _descend(self, goal, x, evaluation):
        """Levenberg-Marquardt from ``x``, or from a stiffer or softer one when some pose cannot be solved there."""
        logs = self._logs()
        for factor in _LADDER:
            start = np.clip(x + np.where(logs, np.log(factor), 0.0), goal.low, goal.high)
            minimum = levenberg_marquardt(goal, start, known=evaluation if factor == 1.0 else None)
            if np.isfinite(minimum.cost):
                return minimum
        return minimum

    def seen_by_normals(self, minimum):
        """The minimum of another distance with all its residuals, for the statistics and the poses."""
        old = self.evaluator
        self.evaluator = self.evaluator_of(self.poses)
        self.evaluator.equilibria = old.equilibria
        start = minimum.evaluation.configuration
        return replace(minimum, evaluation=self.evaluator(minimum.shared, minimum.local, start=start))

    def with_priors(self, minimum, noise):
        """The fit again, with the nearly known numbers free under their priors."""
        return self._finite(levenberg_marquardt(self.goal(self.scale(noise)), minimum.shared, minimum.local))

    def _finite(self, minimum):
        if np.isfinite(minimum.cost):
            return minimum
        codes = np.asarray(minimum.evaluation.verdict.code)
        bad = [
            f"{n}: {SENTENCES[int(c)]}" for n, c in zip([p.name for p in self.study.fit_poses], codes, strict=True) if c != 0
        ]
        raise Scan2FlexError(
            f"no values in the range let every pose settle ({'; '.join(bad)}): check clamps, length and turns of these poses"
        )


def _check(study, method, distance, data="curve"):
    if data not in DATA:
        raise Scan2FlexError(f"data {data!r} is not known: use one of {', '.join(DATA)}")
    if method not in METHODS:
        raise Scan2FlexError(f"method {method!r} is not known: use one of {', '.join(METHODS)}")
    if distance not in DISTANCES:
        raise Scan2FlexError(f"distance {distance!r} is not known: use one of {', '.join(DISTANCES)}")
    if distance == "hausdorff" and method == "least-squares":
        raise Scan2FlexError("the Hausdorff distance has no least squares: use method bfgs or nelder-mead with it")
    if isinstance(study, Study) and not study.unknowns:
        raise Scan2FlexError("the study declares nothing under [unknown]: there is nothing to fit")
    check_study(study)


def _held_out(study, length, elements):
    return poses_of(study.validate_poses, length, elements) if study.validate_poses else None


def _without_guesses(study):
    cable = {k: v for k, v in study.cable.items() if k not in _STIFF or k not in study.unknown_names}
    unknowns = tuple(replace(u, guess=None) if u.name in _STIFF else u for u in study.unknowns)
    return replace(study, cable=cable, unknowns=unknowns)


def _stated_noise(study):
    stated = [p.noise for p in study.fit_poses if p.noise is not None]
    return float(np.sqrt(np.mean(np.square(stated)))) if len(stated) == len(study.fit_poses) else None


def _pose_fits(problem, minimum, covariance):
    out, spread = {}, {}
    groups = [(problem.study.fit_poses, problem.poses, minimum.evaluation)]
    if problem.study.validate_poses:
        poses, found = problem.held_out, problem.predicted(minimum)
        groups.append((problem.study.validate_poses, poses, found))
        own = [np.asarray(m) > 0 for m in poses.mask]
        moved = [J[keep] for J, keep in zip(np.asarray(found.jacobian), own, strict=True)]
        names = [p.name for p in problem.study.validate_poses]
        spread = {name: unseen_spread(problem.layout, J, covariance) for name, J in zip(names, moved, strict=True)}
    for study_poses, poses, e in groups:
        for i, pose in enumerate(study_poses):
            real = np.asarray(poses.mask[i]) > 0
            r, code = e.residual[i][real], int(e.verdict.code[i])
            d = np.linalg.norm(r, axis=1) if code == 0 else np.full(len(r), np.nan)
            out[pose.name] = PoseFit(
                pose.role,
                float(np.sqrt(np.mean(d**2))),
                float(np.max(d)),
                code == 0,
                np.asarray(poses.points[i])[real],
                np.asarray(e.configuration.r[i]),
                e.s[i][real],
                r,
                SENTENCES[code],
                spread.get(pose.name, 0.0),
            )
    order = [p.name for p in problem.study.poses]
    return {name: out[name] for name in order if name in out}


def _estimates(layout, x, known):
    values, out = values_of(layout, x), {}
    for slot in layout.slots:
        here = slice(slot.at, slot.at + slot.size)
        center, spread = x[here], np.sqrt(np.diag(known.covariance))[here]
        bound = np.any((center <= np.array(slot.low) + 1e-9) | (center >= np.array(slot.high) - 1e-9))
        low, high = center - _NORMAL_95 * spread, center + _NORMAL_95 * spread
        std = spread
        if slot.log:
            low, high, std = np.exp(low), np.exp(np.minimum(high, 700.0)), np.exp(center) * spread
        shaped: list = (
            [np.reshape(v, slot.shape) for v in (std, low, high)]
            if np.all(np.isfinite(spread)) and not (slot.log and np.any(spread > _SAYABLE))
            else [None] * 3
        )
        shaped = [v if v is None or slot.shape else float(v) for v in shaped]
        value = values[slot.name] if slot.shape else float(values[slot.name])
        std, low, high = shaped
        determined = bool(np.all(known.determined[here]))
        at_bound = bool(bound) and determined  # where a number that no pose feels stands says nothing of its range
        out[slot.name] = Estimate(value, std, low, high, determined, at_bound, unit_of(slot.name))
    return out


def _bound_sentences(estimates):
    return [
        f"{n} lies at a bound of its range: widen the range or question the model" for n, e in estimates.items() if e.at_bound
    ]


def _validity(poses, noise, stated, length):
    """Does the model predict the poses that were never fitted, to within the noise, their tolerances and the estimates' errors?

    Without a stated noise the fit's own residual stands for it; when that varies slowly along the cable it is no scanner's
    noise, and nothing that it leaves can be called "within the noise".
    """
    rms = {n: p.rms for n, p in poses.items() if p.role == "validate"}
    floor = np.sqrt(2.0) * noise.total
    slow = noise.correlated > _SLOW * noise.white and noise.correlation_length > _LONG * length
    if stated is None and slow and floor > _MESH * length:
        left = f"the residual varies slowly along the cable ({1e3 * floor:.2f} mm), unlike the noise of a scanner"
        return (False if rms else None), [f"{left}: something is missing or misread"]
    if not rms:
        return None, ["no validate pose: whether the model predicts other poses is not known"]
    bad = [n for n, v in rms.items() if not v <= _PREDICTED * np.hypot(floor, poses[n].spread)]
    worst = max(bad or rms, key=lambda n: np.inf if np.isnan(rms[n]) else rms[n])
    beside = f"({1e3 * rms[worst]:.2f} mm beside {1e3 * floor:.2f} mm)"
    if poses[worst].spread > _FELT * floor:
        what = "of noise, and what tolerances and errors of the estimates may do"
        beside = f"({1e3 * rms[worst]:.2f} mm beside {1e3 * floor:.2f} mm {what}, {1e3 * poses[worst].spread:.2f} mm)"
    if not bad:
        return True, [f"validate poses are predicted to within the noise {beside}"]
    return False, [f"the model does not predict {', '.join(bad)} to within the noise {beside}: something is missing or misread"]
