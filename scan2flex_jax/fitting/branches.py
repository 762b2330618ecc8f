"""Which of the branches that differ by a full turn a measured pose is on.

Two quaternions tell the twist of a cable up to half a turn, and only beside a curve: where a cable winds, or is twisted by
nearly half a turn, what `turns` counts is a matter of convention. A measured curve then leads to an equilibrium far from it,
and that would look like missing physics. So poses that are left far from what was measured are solved with a turn more and a
turn less too; a fit that then comes far closer gets those turns, and the user is told.
"""

from dataclasses import replace

import numpy as np

from scan2flex_jax.fitting.poses import poses_of

FAR = 0.003  # of the length: RMS distance from which on a pose may be on another branch
ASTRAY = 0.01  # of the length: one from which on a minimum may have gone where it is for the sake of a wrong branch
_SAME = 1.01  # times the least distance: the same shape
BETTER = 0.5  # of the squared distance of all poses: what other turns have to come down to


def distances(evaluation, mask) -> np.ndarray:
    """RMS distance (m) of each pose; infinite where it was not solved."""
    squares = np.sum(evaluation.residual**2, axis=(1, 2)) / np.sum(np.asarray(mask), axis=1)
    return np.where(np.asarray(evaluation.verdict.code) == 0, np.sqrt(squares), np.inf)


def nearest(problem, study_poses, doubtful, shared, factor: float = 1.0) -> dict[str, int]:
    """Turns, where they are not the study's, that bring doubtful poses nearest to their measured curves at some shared numbers,
    and to less than ``factor`` of the distance with the study's turns."""
    out = {}
    for pose in (p for p, doubt in zip(study_poses, doubtful, strict=True) if doubt and p.end is not None):
        found = {t: _distance(problem, replace(pose, turns=t), shared) for t in (pose.turns, pose.turns - 1, pose.turns + 1)}
        alike = [t for t in found if found[t] <= _SAME * min(found.values())]
        best = min(alike, key=abs)  # two turns may slip over the cable itself and lead to the same shape
        if best != pose.turns and found[best] < factor * found[pose.turns]:
            out[pose.name] = best
    return out


def _distance(problem, pose, shared):
    poses = poses_of(problem.study, [pose], problem.length, problem.elements)
    evaluator = problem.evaluator_of(poses)
    found = evaluator(shared)
    problem.evaluator.equilibria += evaluator.equilibria
    return float(distances(found, poses.mask)[0])


def with_turns(study, turns: dict[str, int]):
    """The study with other turns in some poses."""
    if all(turns.get(p.name, p.turns) == p.turns for p in study.poses):
        return study
    return replace(study, poses=tuple(replace(p, turns=turns.get(p.name, p.turns)) for p in study.poses))


def sentences(before, after) -> tuple[str, ...]:
    """What the user has to know of poses whose turns are others in the study ``after``."""
    changed = [(a.name, a.turns, b.turns) for b, a in zip(before.poses, after.poses, strict=True) if a.turns != b.turns]
    return tuple(
        f"pose {name} was solved with turns = {found} in place of {said}: a full turn nearer to the measured shape"
        for name, found, said in changed
    )
