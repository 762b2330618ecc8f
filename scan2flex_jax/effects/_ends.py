"""Catalogue entries of the clamps and of the scanner.

Where an effect has one value per end, the site says which ends may have it (``ends``: 1 or 0 for start and end);
amplitudes of the others do nothing.
"""

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.effects._loads import XYZ
from scan2flex_jax.effects._materials import _plain
from scan2flex_jax.effects.catalogue import CatalogueEntry, SameShapes
from scan2flex_jax.effects.clamp_offset import ClampOffset
from scan2flex_jax.effects.clamp_rotation import ClampRotation
from scan2flex_jax.effects.elastic_clamp import ElasticClamp
from scan2flex_jax.effects.increments import LengthFactor
from scan2flex_jax.effects.scan_offset import ScanOffset
from scan2flex_jax.effects.scan_scale import ScanScale
from scan2flex_jax.study.kinds import ENDS


def _held(c):
    return np.array([float(end in c.clamped_ends) for end in ENDS])


def _which(c):
    """Both ends, then each of them."""
    sites = [_held(c) * np.array(mask) for mask in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))]
    kept = {tuple(mask): {"ends": mask} for mask in sites if mask.any()}
    return tuple(kept.values())


def _unyielding(per_end):
    """Which amplitudes do nothing, ``per_end`` of them each: those of the ends that a site leaves out."""
    return lambda site: np.repeat(np.asarray(site["ends"]) == 0, per_end)


def _rows(a, site, c):
    """Values of the clamped ends, (ends, 3)."""
    rows = [i for i, end in enumerate(ENDS) if end in c.clamped_ends]
    return (np.asarray(a).reshape(2, 3) * np.asarray(site["ends"])[:, None])[rows]


def _vectors(name, cls):
    """``build`` and the rest of a kind with one vector per end."""

    def back(p, c):
        full = np.zeros((2, 3))
        given = np.asarray(p[name], float)
        full[[i for i, end in enumerate(ENDS) if end in c.clamped_ends] if len(given) < 2 else [0, 1]] = given
        return full.reshape(-1), {"ends": np.any(full != 0, axis=1).astype(float)}

    return {
        "build": lambda a, site, c: (cls(a.reshape(2, 3) * jnp.asarray(site["ends"])[:, None]),),
        "to_parameters": lambda a, site, c: {name: _rows(a, site, c)},
        "from_parameters": back,
        "sites": _which,
        "inactive_of": _unyielding(3),
    }


def _stiffness(a, site, c):
    c_ = np.asarray(a, float) * np.asarray(site["ends"])
    k = 1.0 / np.maximum(c_, 1e-12 * c.length / c.bending_stiffness)
    return {"stiffness": k[[i for i, end in enumerate(ENDS) if end in c.clamped_ends]]}


def _compliance(p, c):
    full = np.zeros(2)
    given = 1.0 / np.asarray(p["stiffness"], float)
    full[[i for i, end in enumerate(ENDS) if end in c.clamped_ends] if len(given) < 2 else [0, 1]] = given
    return full, {"ends": (full > 0).astype(float)}


ENTRIES = (
    CatalogueEntry(
        "elastic_clamp", "clamps", ("compliance at start", "compliance at end"),
        lambda c: np.full(2, 0.02 * c.length / c.bending_stiffness),  # a grip as soft as two per cent of the cable
        build=lambda a, site, c: (ElasticClamp(compliance=a * jnp.asarray(site["ends"])),),
        to_parameters=_stiffness,
        from_parameters=_compliance,
        sites=_which, inactive_of=_unyielding(1), one_sided=(True, True),
        signature="the cable leaves a clamp at an angle that grows with the moment there",
        settle="scan the edges of the clamps along with the cable, and measure the free length",
        same_shapes=(SameShapes("length_error", "when the position of the clamp's edge and the free length are not known"),
                     SameShapes("stiffness_profile", "a softer span at the clamp", always=True)),
    ),
    CatalogueEntry(
        "clamp_rotation", "clamps", tuple(f"{end} about {d}" for end in ENDS for d in ("d1", "d2", "d3")),
        lambda c: np.full(6, 0.03),  # rad: two degrees, what a bracket is off by when no one measures it
        **_vectors("rotation", ClampRotation), bounds_of=lambda c: (np.full(6, -0.8), np.full(6, 0.8)),
        signature="the misfit is largest next to a clamp, turns with the clamp and is alike in all poses",
        settle="scan the clamps and their roll marks along with the cable",
        same_shapes=(SameShapes("natural_curvature", "a roll of one end and natural twist", always=True),),
    ),
    CatalogueEntry(
        "clamp_offset", "clamps", tuple(f"{end} along {d}" for end in ENDS for d in ("d1", "d2", "d3")),
        lambda c: np.full(6, 0.003 * c.length),  # three millimetres on a metre
        **_vectors("offset", ClampOffset),
        signature="the misfit is a shift next to a clamp that turns with the clamp",
        settle="scan the edges of the clamps along with the cable",
        same_shapes=(SameShapes("length_error", "a shift along the tangent of a clamp whose neighbourhood is straight"),
                     SameShapes("scan_offset", "the same shift of both clamps, when no pose turns them")),
    ),
    CatalogueEntry(
        "length_error", "clamps", ("log length",),
        lambda c: np.array([0.01]),  # one per cent: a cable that slid in its clamp, a tape measure on a coil
        build=lambda a, site, c: (LengthFactor(a[0]),),
        to_parameters=lambda a, site, c: {"length": c.length * float(np.exp(np.asarray(a)[0]))},
        from_parameters=lambda p, c: (np.log([float(p["length"]) / c.length]), {}),
        bounds_of=lambda c: (np.full(1, -0.3), np.full(1, 0.3)),
        signature="all poses sag too much or too little",
        settle="measure the length between the clamps",
        same_shapes=(SameShapes("elastic_clamp", "when the position of the clamp's edge is not known"),),
    ),
    CatalogueEntry(
        "scan_scale", "observation", ("log factor",),
        lambda c: np.array([0.01]),  # one per cent, a poor calibration of the scanner
        build=lambda a, site, c: (ScanScale(jnp.exp(a[0])),),
        to_parameters=lambda a, site, c: {"factor": float(np.exp(np.asarray(a)[0]))},
        from_parameters=lambda p, c: (np.log([float(p["factor"])]), {}),
        bounds_of=lambda c: (np.full(1, -0.3), np.full(1, 0.3)),
        signature="every coordinate is off in proportion to its distance from the origin, the clamps' surroundings too",
        settle="scan an object of known size",
    ),
    CatalogueEntry(
        "scan_offset", "observation", XYZ,
        lambda c: np.full(3, 0.002 * c.length),  # two millimetres on a metre: one side of the cable, a marker's base
        **_plain("offset", ScanOffset, 3),
        signature="all points of all poses are shifted alike, at the clamps too",
        settle="scan the clamps along with the cable",
        same_shapes=(SameShapes("clamp_offset", "the same shift of both clamps, when no pose turns them"),),
    ),
)  # fmt: skip
