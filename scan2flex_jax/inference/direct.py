"""The sequence of a fit to point clouds: choice of the data, descent, statistics, and the results of every pose."""

from dataclasses import replace

import jax
import numpy as np

from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.fitting import cloud
from scan2flex_jax.fitting.distance import curve_at
from scan2flex_jax.fitting.evaluate import observed
from scan2flex_jax.fitting.least_squares import Minimum, Progress, silent
from scan2flex_jax.fitting.parameters import model_at
from scan2flex_jax.fitting.poses import check_no_memory
from scan2flex_jax.fitting.problem import Problem, unsettled
from scan2flex_jax.geometry import curves
from scan2flex_jax.inference import cloud_noise
from scan2flex_jax.inference.fit_result import PoseFit
from scan2flex_jax.inference.settings import USUAL, Settings
from scan2flex_jax.statics.verdict import SENTENCES
from scan2flex_jax.study import MeasuredCurve

COARSE = 0.25  # of the radius: noise of a point beyond which its distance to the axis is biased
_EXPLAINED = 0.6  # fraction of the points near the cable that lie on its surface, below which a sentence reports it


def measured_by(study, data, method, distance, progress):
    """``(study with a curve for every pose, its `NearCurve` by pose name or None for a fit to curves, sentences)``.

    "auto": given curves if every pose has one; else clouds, if all poses have one with noise well below the radius. Measured
    (`benchmarks/virtual_experiments.py`): errors of estimates from clouds of a structured-light scanner are two to six times
    smaller than from extracted curves, from a time-of-flight camera up to three times larger (by 0.1 %); their intervals are
    several times narrower than those from curves, and contained the truth in every run.
    """
    bare = [p.name for p in study.poses if p.curve is None]
    marked = any(p.markers is not None for p in study.poses)
    if data == "cloud":
        check_no_memory(study, "fit the curves (data 'curve')")
        _check_clouds(study, method, distance)
    elif not any(p.scan for p in study.poses if p.curve is None):
        return study, None, ()
    elif data == "curve" or marked or study.remembers or method != "least-squares" or distance != "normal" or not all(
        p.scan for p in study.poses
    ):
        whole, doubts = _with_curves(study, progress)
        return whole, None, ("centre curves were extracted from the scans and fitted", *doubts)
    scans, whole = _clouds(study, progress)
    rough = [n for n, scan in scans.items() if scan.noise is not None and scan.noise > COARSE * study.cable["radius"]]
    refused = [n for n in bare if scans[n].refused]
    if data == "auto" and rough and not refused:
        said = f"the points of pose {rough[0]!r} are uncertain by more than {100 * COARSE:.0f} % of the radius"
        return whole, None, (f"{said}: centre curves were extracted from the scans and fitted",)
    words = [f"extraction refused pose {n!r}: the direct fit began from a coarse curve ({scans[n].refused})" for n in refused]
    return whole, scans, tuple(words)


def _check_clouds(study, method, distance):
    without = [p.name for p in study.poses if p.scan is None]
    marked = [p.name for p in study.poses if p.markers is not None]
    if marked:
        raise Scan2FlexError(f"pose {marked[0]!r} has markers, which a fit to clouds does not see: leave data out")
    if without:
        raise Scan2FlexError(f"pose {without[0]!r} has no scan: data 'cloud' needs one for every pose")
    if method != "least-squares" or distance != "normal":
        raise Scan2FlexError("clouds are fitted by least-squares with their own distance: leave method and distance out")


def _with_curves(study, progress):
    from scan2flex_jax.scan import extract_study  # noqa: PLC0415  (only scans need it, and it loads slowly)

    whole, found = extract_study(study, lambda name, i, n: progress(f"extracting {name} ({i} of {n})"))
    return whole, [f"the centre curve of pose {n!r} is doubtful: {'; '.join(c.doubts)}" for n, c in found.items() if not c.sure]


def _clouds(study, progress):
    from scan2flex_jax.scan import near_curve  # noqa: PLC0415  (only scans need it, and it loads slowly)

    scans = {}
    for pose in study.poses:
        progress(f"reading the cloud of {pose.name}")
        scans[pose.name] = near_curve(study, pose)
    poses = tuple(replace(p, curve=p.curve or MeasuredCurve(scans[p.name].curve)) for p in study.poses)
    return scans, replace(study, poses=poses)


class Direct:
    """The direct fit of one study, from the problem of its curves, which gives the start, and its scans."""

    def __init__(self, problem: Problem, scans, progress: Progress = silent, settings: Settings = USUAL):
        """Nothing is solved yet."""
        self.problem, self.scans, self.progress, self.settings = problem, scans, progress, settings
        self.radius = float(problem.study.cable["radius"])
        self.evaluator = self._evaluator(problem.study.fit_poses, problem.poses)
        self.others: cloud.CloudEvaluator | None = None

    def _evaluator(self, study_poses, poses):
        near = [self.scans[p.name] for p in study_poses]
        length = self.problem.length
        scans = cloud.scans_of(poses, [n.points for n in near], [n.curve for n in near], length)
        return cloud.CloudEvaluator(self.problem, scans, self.radius, [p.viewpoints for p in study_poses])

    @property
    def equilibria(self) -> int:
        """Number of equilibria solved, those of the start included."""
        others = 0 if self.others is None else self.others.equilibria
        return self.problem.evaluator.equilibria + self.evaluator.equilibria + others

    def fit(self, minimum: Minimum):
        """``(minimum, noise, uncertainty)`` from the minimum of the curves; priors need a second descent for their weight."""
        layout, length = self.problem.layout, self.problem.length
        start, factor = minimum.evaluation.configuration, 1.0
        for again in (False, True):
            minimum = cloud.descend(self.problem, self.evaluator, minimum, start, factor, self.progress)
            if not np.isfinite(minimum.cost):
                reasons = unsettled(self.problem.study.fit_poses, minimum.evaluation)
                raise NotSettledError(
                    "no pose settled on the way of the direct fit", "fit the curves (data 'curve') and look", reasons
                )
            found = cloud_noise.stations(self.evaluator, minimum.evaluation, length)
            self.field = cloud_noise.estimate_field(found, layout.shared, length, self.settings)
            spread = cloud.OFFSET * self.radius
            parts = cloud_noise.information(self.evaluator, minimum.evaluation, self.field, spread, length)
            if again or not layout.has_priors:
                break
            factor, start = cloud_noise.inflation(parts, layout.unknowns), minimum.evaluation.configuration
        known = cloud_noise.cloud_uncertainty(layout, parts, factor)
        return minimum, self.field.noise, known

    def pose_fits(self, minimum: Minimum, noise) -> dict[str, PoseFit]:
        """Distances between the axis observed in the cloud and the modelled one, at stations along every pose."""
        study, out = self.problem.study, {}
        groups = [(study.fit_poses, self.evaluator, minimum.evaluation)]
        if study.validate_poses:
            others = self.others = self._evaluator(study.validate_poses, self.problem.held_out)
            others.weights = cloud.weigh(others.look(minimum.shared).raw, others)
            e = others(minimum.shared, derivative=False)
            groups.append((study.validate_poses, others, e))
        for study_poses, evaluator, e in groups:
            found = cloud_noise.stations(evaluator, e, self.problem.length)
            for i, pose in enumerate(study_poses):
                model = model_at(self.problem.layout, evaluator.poses.template(i), minimum.shared)
                out[pose.name] = self._pose_fit(pose, found[i], e, i, model)
        expected = np.sqrt(2.0) * noise.total
        unseen = {n: replace(p, ratio=p.rms / expected) for n, p in out.items() if p.role == "validate"}
        return {p.name: (out | unseen)[p.name] for p in study.poses}

    def _pose_fit(self, pose, found, e, i, model):
        r, d3 = np.asarray(e.configuration.r[i]), np.asarray(e.configuration.R[i][:, :, 2])
        points, axes = _axes(observed(model, r), d3, self.problem.length / (len(r) - 1), found.s)
        code = int(e.verdict.code[i])
        u = found.u if code == 0 else np.full_like(found.u, np.nan)
        away = np.linalg.norm(u, axis=1)
        measured = np.asarray(points) + np.einsum("nc,nci->ni", found.u, np.asarray(axes))
        residual = np.concatenate([u, np.zeros((len(u), 1))], axis=1)
        rms, worst = (float(np.sqrt(np.mean(away**2))), float(np.max(away))) if len(u) else (np.nan, np.nan)
        return PoseFit(pose.role, rms, worst, code == 0, measured, r, found.s, residual, SENTENCES[code])

    def sentences(self) -> list[str]:
        """Sentences on the number of points, the offsets of the radius, and scans that the cable explains badly."""
        parts = [(self.problem.study.fit_poses, self.evaluator)]
        parts += [] if self.others is None else [(self.problem.study.validate_poses, self.others)]
        said, offsets, count = [], [], 0
        for study_poses, evaluator in parts:
            for i, pose in enumerate(study_poses):
                weights = evaluator.weights
                count += int(np.sum(weights.weight[i] > 0))
                offsets.append(weights.offset[i])
                away = np.linalg.norm(np.asarray(evaluator.poses.points[i]) - weights.axis[i], axis=1)
                away = away[(np.asarray(evaluator.poses.mask[i]) > 0) & (away > 0)]  # beside the rod, not beyond its ends
                share = np.mean(np.abs(away - self.radius) < cloud.TUKEY * weights.sigma[i]) if len(away) else 0.0
                if share < _EXPLAINED:
                    said.append(f"only {100 * share:.0f} % of the points near pose {pose.name!r} lie on the cable's surface")
                if evaluator.weights.sigma[i] > COARSE * self.radius and pose.viewpoints is None:
                    said.append(
                        f"pose {pose.name!r}: a point is uncertain by {1e3 * evaluator.weights.sigma[i]:.1f} mm where the"
                        f" radius is {1e3 * self.radius:.1f} mm: distances to the axis are biased; give viewpoints"
                    )
        span = f"{1e3 * min(offsets):+.2f} to {1e3 * max(offsets):+.2f} mm"
        return [f"fitted to the points of the scans themselves ({count} of them; the radius shows an offset of {span})", *said]


@jax.jit
def _axes(r, d3, ds, s):
    """Points (n, 3) of the curve at ``s`` and their two normals (n, 2, 3), the ones of `cloud.tube_distances`."""
    frames = curves.transported_frames(d3, curves.frame_on(d3[0]))

    def each(s):
        x, t = curve_at(r, d3, ds, s)
        t = t / jax.numpy.linalg.norm(t)
        n1 = frames[jax.numpy.round(s / ds).astype(int), :, 0]
        n1 = n1 - (n1 @ t) * t
        n1 = n1 / jax.numpy.linalg.norm(n1)
        return x, jax.numpy.stack([n1, jax.numpy.cross(t, n1)])

    return jax.vmap(each)(s)
