"""Parts shared by catalogue entries: spans, fields and places along the cable, the two ends.

`span` and `along` give several fields of a `CatalogueEntry` at once, as keywords. For an effect with one value per end, the
candidate location lists the ends that may have it (``ends``: 1 or 0 for start and end); amplitudes of the other ends are
inactive.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.effects.entry import Context, Site, along_cable, loaded_places, positions
from scan2flex_jax.geometry.fields import POINTS, smooth_root
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS

AXES = ("about d1", "about d2", "about d3")
XYZ = ("x", "y", "z")
Make = Callable[..., AbstractEffect]  # the class of a kind
_WIDTHS = (0.08, 0.18, 0.35)  # of the length: span widths to scan
_STRONG = 0.5  # log factor below which spans of different widths are distinguished by their signatures


def along(name: str, cls: Make) -> dict[str, Any]:
    """Fields of an entry for a field along the cable: amplitudes are the independent components of a smooth random field."""
    root, count = smooth_root(POINTS, 3), 3 * POINTS

    def at(length):
        return np.linspace(0.0, 1.0, POINTS) * length

    return {
        "field": True,
        "amplitudes": tuple(f"component {k}" for k in range(count)),
        "build": lambda a, site, c: (cls(**{name: (jnp.asarray(root) @ a).reshape(POINTS, 3), "s": at(c.length)}),),
    }


def span(cls: Make, carried: Callable[[Any], Any]) -> dict[str, Any]:
    """The same for a span whose amplitude is the logarithm of its factor; ``carried(factor)`` is its excess per length."""

    def other_widths(a, site, c, places):
        """Further starts after a refit that ended at a strong span: spans of other widths with the same total excess."""
        width, factor = float(site["width"]), float(np.exp(a[0]))
        if abs(a[0]) < _STRONG:
            return []
        order = sorted((w * c.length for w in _WIDTHS), key=lambda w: abs(np.log(w / width)))
        out: list = []
        for other in order[1:]:
            wanted, trial = carried(factor) * width / other, np.geomspace(0.06, 17.0, 400)
            best = trial[np.argmin(np.abs(carried(trial) - wanted))]
            out.append((np.log([best]), {**site, "width": other}, {}))
        return out

    return {
        "moving": {"position": along_cable, "width": lambda c: (0.5 * (_WIDTHS[0] * c.length), 1.5 * (_WIDTHS[-1] * c.length))},
        "other_starts": other_widths,
        "amplitudes": ("log factor",),
        "build": lambda a, site, context: (cls(site["position"], site["width"], jnp.exp(a[0])),),
        "sites": lambda c: tuple(
            {"position": s, "width": w * c.length} for w in _WIDTHS for s in positions(c, 17)
        ),
        "bounds_of": lambda c: (np.log([0.05]), np.log([20.0])),
    }  # fmt: skip


def places(context: Context) -> tuple[Site, ...]:
    """Candidate locations of an effect at one place (m): evenly spaced along the cable."""
    return tuple({"position": s} for s in loaded_places(context))


def clamped(context: Context) -> list[int]:
    """The clamped ends: 0 for the start, 1 for the end."""
    return [i for i, end in enumerate(ENDS) if end in context.clamped_ends]


def ends(context: Context) -> tuple[Site, ...]:
    """Candidate locations of an effect at clamps: all of them, then each."""
    held = np.array([float(end in context.clamped_ends) for end in ENDS])
    sites = [held * np.array(mask) for mask in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))]
    kept = {tuple(mask): {"ends": mask} for mask in sites if mask.any()}
    return tuple(kept.values())


def ends_without(per_end: int) -> Callable[[Site], np.ndarray]:
    """Mask of inactive amplitudes, ``per_end`` of them per end: those of the ends absent from a candidate location."""
    return lambda site: np.repeat(np.asarray(site["ends"]) == 0, per_end)
