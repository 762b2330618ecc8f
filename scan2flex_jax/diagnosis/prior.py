"""Priors and ranges of the parameters of a refit, and the frozen ones.

Amplitudes and nuisance parameters have normal priors in units of their size and tolerance; continuous parts of a site are
uniform over the range of their catalogue entry. In every model, log-transformed base parameters have a weak normal prior about
the baseline fit, so that an unidentifiable one keeps its value.
"""

import numpy as np

from scan2flex_jax.diagnosis.sensitivity import Bench, Numbers

_WEAK = 3.0  # standard deviation of the log of a base parameter about the baseline fit: a factor of 20


class Prior:
    """Precision (0 = flat) and bounds of every parameter, and the weak precision of base parameters about their ``centre``."""

    def __init__(self, bench: Bench, components, wider: tuple[float, ...] = ()):
        """From tolerances, sizes and ranges; ``wider``: factor on the usual sizes of each component's amplitudes."""
        n = Numbers(bench, components)
        self.precision, self.low, self.high = np.zeros(n.count), np.full(n.count, -np.inf), np.full(n.count, np.inf)
        self.width = np.zeros(n.count)  # precision that replaces a flat range, in the evidence only
        self.precision[n.nuisance] = n.prior_std**-2
        unknowns = slice(bench.layout.unknowns)
        self.low[unknowns], self.high[unknowns] = bench.layout.ranges
        self.frozen = np.zeros(n.count, bool)
        self.weak, self.centre = np.zeros(n.count), np.zeros(n.count)
        self.weak[unknowns] = np.where(bench.layout.logs, 1.0 / _WEAK**2, 0.0)
        self.centre[: bench.layout.shared] = bench.minimum.shared
        for k, c in enumerate(components):
            at = n.amplitudes(k)
            size = c.entry.size(bench.context) * (wider[k] if wider else 1.0)
            self.precision[at] = 1.0 / size**2
            self.low[at], self.high[at] = c.entry.bounds(bench.context)
            self.frozen[at] = c.entry.inactive(c.site)
            if c.entry.continuation:  # these amplitudes are not estimated
                self.frozen[at], self.precision[at] = True, 0.0
            self._sites(bench, c, n.site(k))

    def _sites(self, bench, c, at):
        for i, name in zip(at, c.moving, strict=True):
            low, high = c.entry.moving[name](bench.context)
            self.low[i], self.high[i] = low, high
            self.width[i] = 12.0 / max(high - low, 1e-12) ** 2
