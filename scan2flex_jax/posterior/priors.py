"""Priors and ranges of the parameters of a hypothesis.

Amplitudes and nuisance parameters are normal in units of their size and tolerance; continuous parts of a site are uniform over
the range of their catalogue entry, which counts as a normal prior of the same variance where a determinant asks for one. The
logarithm of an unknown has a weak normal prior about the baseline fit, so that one that no pose determines keeps its value.
"""

import numpy as np

from scan2flex_jax.posterior.program import Index, Program

_WEAK = 3.0  # standard deviation of the logarithm of an unknown about the baseline fit: a factor of 20


class Prior:
    """Of every parameter its ``precision`` (0: flat), ``low`` and ``high``, the precision ``width`` that stands for a flat
    range, the ``weak`` precision about ``centre``, the ``mean`` of nuisance parameters, and whether it is ``frozen``."""

    def __init__(self, program: Program, components, wider: tuple[float, ...] = (), zero=(), pinned=None):
        """From tolerances, sizes and ranges; ``wider``: factor on the usual sizes of each component's amplitudes; ``zero``:
        those held at zero; ``pinned``: values of others that are held, by their place."""
        n, layout = Index(program, components), program.layout
        self.precision, self.low, self.high = np.zeros(n.count), np.full(n.count, -np.inf), np.full(n.count, np.inf)
        self.width, self.weak, self.centre, self.mean = (np.zeros(n.count) for _ in range(4))
        self.frozen = np.zeros(n.count, bool)
        self.precision[layout.prior.at], self.mean[layout.prior.at] = layout.prior.std**-2, layout.prior.mean
        self.precision[n.shared : n.base] = 1.0
        unknowns = slice(layout.unknowns)
        self.low[unknowns], self.high[unknowns] = layout.ranges
        self.weak[unknowns] = np.where(layout.logs, _WEAK**-2, 0.0)
        wide = np.isfinite(span := self.high[unknowns] - self.low[unknowns]) & ~layout.logs & (self.precision[unknowns] == 0)
        self.width[unknowns] = np.where(wide, 12.0 / np.where(wide, np.maximum(span, 1e-12), 1.0) ** 2, 0.0)
        self.centre[: layout.shared] = program.minimum.shared
        for i, value in (dict.fromkeys(zero, 0.0) | (pinned or {})).items():
            self.low[i] = self.high[i] = value
        for k, c in enumerate(components):
            at = n.amplitudes(k)
            self.precision[at] = (c.entry.size(program.context) * (wider[k] if wider else 1.0)) ** -2.0
            self.low[at], self.high[at] = c.entry.bounds(program.context)
            self.frozen[at] = c.entry.inactive(c.site)
            if c.entry.continuation:  # these amplitudes are set, not estimated
                self.frozen[at], self.precision[at] = True, 0.0
            for i, name in zip(n.site(k), c.moving, strict=True):
                low, high = c.entry.moving[name](program.context)
                self.low[i], self.high[i], self.width[i] = low, high, 12.0 / max(high - low, 1e-12) ** 2

    def pull(self, x) -> np.ndarray:
        """Half the gradient of the cost of the priors; that of a frozen parameter is zero."""
        return np.where(self.frozen, 0.0, self.precision * (x - self.mean) + self.weak * (x - self.centre))

    def cost(self, x) -> float:
        """Twice the negative log density of the priors at ``x``, up to a constant."""
        return float(self.precision @ (x - self.mean) ** 2 + self.weak @ (x - self.centre) ** 2)
