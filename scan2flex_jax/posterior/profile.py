"""Intervals by profile likelihood, where clamps are uncertain and the curvature of the cost at its minimum misleads.

With clamps that are fitted, a small stiffness is known better than a large one: the interval about the minimum is too short on
the far side. There it is extended to where the cost, minimised over all other parameters under the same noise, has risen by
3.84, the 95 % quantile of chi-squared with one degree of freedom. Intervals are never shortened.
Reference: Venzon and Moolgavkar, "A method for computing profile-likelihood-based confidence intervals" (1988).
"""

from dataclasses import replace

import numpy as np

from scan2flex_jax.posterior.estimate import NORMAL_95, Estimate
from scan2flex_jax.posterior.posterior import Fitted

_RISE = NORMAL_95**2
_CURVED = 0.1  # standard deviation of a logarithm from which the cost is not a parabola
_TRIES, _FARTHEST = 6, 5.0  # steps outwards, and the longest half interval of a logarithm


def profiled(h: Fitted, estimates: dict[str, Estimate]) -> dict[str, Estimate]:
    """The estimates of a hypothesis without effects, with wider intervals where the cost rises more slowly than a parabola."""
    out, layout = dict(estimates), h.variant.program.layout
    for slot in layout.slots if layout.local else ():
        e = out[slot.name]
        if slot.log and not slot.shape and not slot.walk and e.identifiable and e.low is not None:
            value, near, far = (float(np.max(v)) for v in (e.value, e.low, np.asarray(e.high)))
            if np.log(far / near) > 2 * NORMAL_95 * _CURVED:
                low, high = (value * float(np.exp(_end(h, slot.at, np.log(t / value)))) for t in (near, far))
                out[slot.name] = replace(e, low=min(near, low), high=max(far, high))
    return out


def _end(h, at, t):
    """Displacement of a parameter, of the sign of ``t`` and no shorter, at which the profiled cost has risen by `_RISE`."""
    v = h.variant
    Li, base = v.likelihood.whitening(h.u, h.linear.Z), h.chi2 + h.linear.quad
    x, shapes, before, risen = h.x, h.shapes, 0.0, 0.0
    for _ in range(_TRIES):
        found = v.descended(x, shapes, Li, pinned={at: h.x[at] + t})
        if found is None:
            return t
        x, shapes, _, cost = found
        rise = cost - base
        if rise >= _RISE or abs(t) >= _FARTHEST:
            break
        before, risen = t, max(rise, 0.0)
        t = np.sign(t) * min(abs(t) * float(np.clip(np.sqrt(_RISE / max(risen, 1e-3)), 1.1, 2.0)), _FARTHEST)
    share = (np.sqrt(_RISE) - np.sqrt(risen)) / max(np.sqrt(max(rise, 0.0)) - np.sqrt(risen), 1e-9)
    return before + (t - before) * float(np.clip(share, 0.0, 1.0))
