"""`residual_function`: a study as one traced JAX function of its parameters, for other solvers, samplers and losses.

    function, start = residual_function(load_study("my-cable"))
    optimistix.least_squares(lambda x, _: function(x), optimistix.LevenbergMarquardt(1e-8, 1e-8), start)
    jax.hessian(lambda x: 0.5 * jnp.sum(function(x) ** 2))(start)

The function is pure: every call solves all poses from their measured curves. It can be differentiated to any order, compiled
and vmapped over ``x``.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from scan2flex_jax.compilation import compiled
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import states
from scan2flex_jax.fitting.noise import metre_noise
from scan2flex_jax.fitting.parameters import Layout, boundary_at, layout_of, model_at, start_vector, values_of
from scan2flex_jax.fitting.poses import Poses, check_distance, check_no_memory, poses_of
from scan2flex_jax.fitting.readings import change
from scan2flex_jax.fitting.start import length_start, own_start
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.statics.verdict import SOLVED, Verdict
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.sense import check_study

DISTANCES = ("closest", "integrated")


class ResidualFunction(eqx.Module):
    """Residuals of a study's poses as a function of a vector ``x``; made by `residual_function`.

    ``x`` holds the unknowns, positive ones by their logarithm, laws by its increments from point to point, and, if a noise is
    given, the nuisance parameters in units of their tolerance: of the length, of gravity, then of each pose's clamps.
    """

    layout: Layout = eqx.field(static=True)
    poses: Poses
    real: Int[np.ndarray, " k"]
    noise: Float[Array, ""] | None
    elements: int = eqx.field(static=True)
    distance: str = eqx.field(static=True)

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for each entry of ``x``."""
        said = [
            "component of " if slot.root else "increment of log " if slot.walk else "log " if slot.log else ""
            for slot in self.layout.slots
        ]
        named = [words + label for words, slot in zip(said, self.layout.slots, strict=True) for label in slot.labels]
        shared = [f"prior[{i}]" for i in range(self.layout.shared - self.layout.unknowns)]
        own = [f"prior[pose {p}, {i}]" for p in range(self.poses.count) for i in range(self.layout.local)]
        return (*named, *shared, *own)

    def values(self, x: Float[Array | np.ndarray, " n"]) -> dict[str, np.ndarray]:
        """The unknowns in their own units, by name."""
        return values_of(self.layout, np.asarray(x))

    def verdicts(self, x: Float[Array, " n"]) -> Verdict:
        """Status of the solve of each pose (leading axis: poses)."""
        return self._solved(x)[1]

    def __call__(self, x: Float[Array, " n"]) -> Float[Array, " k"]:
        """Measured minus modelled: three components of every point and reading of every pose, in m (readings in other units by
        their noise), or over the noise and followed by the priors. Infinite for a pose without a stable equilibrium, so that
        a line search or a sampler rejects ``x``."""
        residual, verdict = self._solved(x)
        solved = verdict.solved[:, None, None]
        flat = jnp.where(solved, residual, jnp.inf).ravel()[self.real]
        if self.noise is None:
            return flat
        return jnp.concatenate([flat / self.noise, self.layout.prior.pull(x), x[self.layout.shared :]])

    def _solved(self, x):
        if jnp.shape(x) != (len(self.labels),):
            raise Scan2FlexError(f"x has shape {jnp.shape(x)}: give {len(self.labels)} numbers ({', '.join(self.labels[:6])}).")
        return _residuals(self, jnp.asarray(x, float))


@compiled
def _residuals(function: ResidualFunction, x):
    residual, (_, _, verdict, _) = of_poses(function, x, lambda residual, own: residual(own))
    return residual, verdict


def of_poses(function: ResidualFunction, x, call, start: Configuration | None = None):
    """``call(residual, own)`` of every pose, stacked: ``own`` are the numbers of ``x`` that the pose depends on, and
    ``residual(own)`` is its `states.shape`, solved from ``start`` (default: the measured curves)."""
    layout, poses = function.layout, function.poses
    own = x[layout.shared :].reshape(poses.count, layout.local)
    other, start = poses.reference, poses.start if start is None else start
    targets = states.Target(poses.points, poses.mask, poses.expected, poses.marked, poses.rows, poses.readings)
    before = poses if other is None else other  # whose supports and starts are unused without changes
    each = jax.tree.map(jnp.asarray, (poses.boundary, targets, start, own, before.boundary, before.start))
    keys = list(zip(poses.group, before.group, poses.changes or poses.group, strict=True))
    groups = sorted(set(keys))

    def solved(template, boundary, start, target, own):
        model = model_at(layout, template, own[: layout.shared])
        laws = states.slots_of(model.effects)
        state = states.state_of(model, boundary_at(layout, boundary, own[layout.shared :]), function.elements, laws)
        return states.shape(state, start, target, function.distance)

    def of_group(key):
        def one(pose):
            boundary, target, start, z, *reference = pose

            def residual(own):
                r, rest = solved(poses.templates[key[0]], boundary, start, target, own)
                if other is None or not key[2]:
                    return r, rest
                zero = target._replace(points=jnp.zeros_like(target.points))
                unloaded, (*_, verdict, _) = solved(other.templates[key[1]], reference[0], reference[1], zero, own)
                s, configuration, own_verdict, axes = rest
                worst = jax.tree.map(lambda a, b: jnp.where(own_verdict.code == SOLVED, b, a), own_verdict, verdict)
                return change(r, unloaded, target.readings), (s, configuration, worst, axes)

            return call(residual, jnp.concatenate([x[: layout.shared], z]))

        return jax.lax.map(one, each if len(groups) == 1 else jax.tree.map(lambda v: v[members(key)], each))

    def members(key):
        return np.flatnonzero([k == key for k in keys])

    found = [of_group(key) for key in groups]
    order = np.argsort(np.concatenate([members(key) for key in groups]))
    return found[0] if len(found) == 1 else jax.tree.map(lambda *v: jnp.concatenate(v)[order], *found)


def residual_function(
    study: Study, *, noise: float | None = None, elements: int = 40, distance: str = "closest"
) -> tuple[ResidualFunction, Float[Array, " n"]]:
    """``(function, start)``: the residuals of the ``fit`` poses of ``study`` as a pure JAX function, and a start for a fit.

    Args:
        study: One cable; its ``fit`` poses need a centre curve or markers.
        noise: Standard deviation of one coordinate (m). It divides the residuals and adds the study's tolerances as standard
            normal priors: half the sum of squares is then the negative logarithm of a posterior density with white noise.
            Without it residuals are in m, and stated values are taken as exact.
        elements: Elements of the rod.
        distance: "closest" (to the closest point of the modelled curve; its square has exact first and second derivatives) or
            "integrated" (at equal arc length; paper, Eq. 10).

    Returns:
        A `ResidualFunction`, pure and traced by JAX, and a start vector (n,) of its unknowns.

    Raises:
        Scan2FlexError: A pose has no curve and no markers, an effect has memory, or an argument has another value than those
            above.

    Examples:
        >>> residuals, start = residual_function(study)  # doctest: +SKIP
        >>> jax.grad(lambda x: (residuals(x) ** 2).sum())(start)  # doctest: +SKIP
    """
    check_study(study)
    if distance not in DISTANCES:
        raise Scan2FlexError(f"distance is {distance!r}: give one of {', '.join(DISTANCES)}.")
    if noise is not None and not 0.0 < noise < np.inf:
        raise Scan2FlexError(f"noise is {noise!r}: give a positive number in m, or None.")
    check_distance(study, distance)
    check_no_memory(study, "use fit")
    layout = layout_of(study)
    if noise is None:
        layout = Layout(layout.slots, 0.0, 0.0, 0.0, 0.0, rigid=layout.rigid)
    if not layout.slots:
        raise Scan2FlexError("the study declares no unknown: declare what is to be estimated.")
    length = length_start(study)
    poses = poses_of(study, study.fit_poses, length, elements)
    if noise is not None:
        poses = poses.weighed(noise / np.array([metre_noise(study, pose, length) for pose in study.fit_poses]))
    real = np.flatnonzero(np.repeat(np.asarray(poses.mask).ravel() > 0, 3))
    spread = None if noise is None else jnp.asarray(noise, float)
    function = ResidualFunction(layout, poses, real, spread, elements, distance)
    unknown = start_vector(study, layout, own_start(study, poses, length))
    rest = len(function.labels) - layout.unknowns
    return function, jnp.concatenate([jnp.asarray(unknown), jnp.zeros(rest)])
