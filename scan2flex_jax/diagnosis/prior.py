"""What a refit knows of its numbers before it sees the shapes: priors, ranges, and which numbers do not move.

Amplitudes and nearly known numbers are normal in units of their size and tolerance; continuous parts of a site are flat over
the range that their catalogue entry states. Logarithms of the base numbers have a weak normal prior about the plain fit, in
every model alike, so that a number that no pose feels stays where it was.
"""

import numpy as np

from scan2flex_jax.diagnosis.sensitivity import Bench, Numbers

_WEAK = 3.0  # standard deviation of the logarithm of a base number about the plain fit's: a factor of 20


class Prior:
    """Precision (0 = flat) of every number, its bounds, and the weak precision of base numbers about their ``centre``."""

    def __init__(self, bench: Bench, components, wider: tuple[float, ...] = ()):
        """From tolerances, sizes and ranges; ``wider``: per component the factor on the usual sizes of its amplitudes."""
        n = Numbers(bench, components)
        self.precision, self.low, self.high = np.zeros(n.count), np.full(n.count, -np.inf), np.full(n.count, np.inf)
        self.width = np.zeros(n.count)  # precision that stands for a flat range, in the evidence only
        self.precision[n.nearly_known] = n.prior_std**-2
        self.low[: bench.layout.unknowns] = [v for s in bench.layout.slots for v in s.low]
        self.high[: bench.layout.unknowns] = [v for s in bench.layout.slots for v in s.high]
        self.frozen = np.zeros(n.count, bool)
        self.weak, self.centre = np.zeros(n.count), np.zeros(n.count)
        logs = [slot.scales for slot in bench.layout.slots for _ in range(slot.size)]
        self.weak[: bench.layout.unknowns] = np.where(logs, 1.0 / _WEAK**2, 0.0)
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
