"""Catalogue entries of loads and of what the cable touches."""

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.effects._materials import _plain
from scan2flex_jax.effects.catalogue import CatalogueEntry, positions
from scan2flex_jax.effects.elastic_support import ElasticSupport
from scan2flex_jax.effects.increments import AnchoredSpring
from scan2flex_jax.effects.point_load import PointLoad
from scan2flex_jax.effects.point_mass import PointMass
from scan2flex_jax.effects.support_plane import CONTACT, SupportPlane
from scan2flex_jax.effects.uniform_load import UniformLoad

XYZ = ("x", "y", "z")


def _places(c):
    return tuple({"position": s} for s in positions(c))


def _levels(c):
    """Heights of planes, from the lowest measured point (in a pose that touches, it lies on the plane) to a little above."""
    low, high = c.lowest_range
    margin = 0.02 * c.length
    return tuple({"offset": h} for h in np.linspace(low - 0.25 * margin, max(high, low) + 2.0 * margin, 13))


def _tether_of(p, c):
    """Amplitude and site of a tether as of one with rest length zero: the same pull at the same place."""
    k, anchor = float(p["stiffness"]), np.asarray(p["anchor"], float) - c.centre
    return np.array([k, *(k * anchor)]), {"position": float(p["position"])}


def _tether_parameters(a, site, c):
    a = np.asarray(a, float)
    anchor = c.centre + a[1:] / a[0] if a[0] > 0 else c.centre + a[1:]
    return {"position": float(site["position"]), "anchor": anchor, "stiffness": float(a[0]), "rest_length": 0.0}


ENTRIES = (
    CatalogueEntry(
        "point_mass", "energy", ("mass",),
        lambda c: np.array([0.15 * c.mass_per_length * c.length]),  # a clip or a ferrite beside the whole cable
        build=lambda a, site, c: (PointMass(site["position"], a[0]),),
        to_parameters=lambda a, site, c: {"position": float(site["position"]), "mass": float(np.asarray(a)[0])},
        from_parameters=lambda p, c: (np.array([float(p["mass"])]), {"position": float(p["position"])}),
        sites=_places, one_sided=(True,),
        signature="the cable sags towards one place of it, always along gravity",
        settle="look for a clip, a marker or a connector at the named place, or weigh the cable",
        same_shapes=(("density_profile", "a span that is short beside the sag"),),
    ),
    CatalogueEntry(
        "point_load", "energy", XYZ,
        lambda c: np.full(3, 0.05 * c.force),  # a lead or a tie that pulls with a twentieth of the weight
        build=lambda a, site, c: (PointLoad(site["position"], a),),
        to_parameters=lambda a, site, c: {"position": float(site["position"]), "force": np.asarray(a)},
        from_parameters=lambda p, c: (np.asarray(p["force"], float), {"position": float(p["position"])}),
        sites=_places,
        signature="the cable is drawn at one place of it, in the same direction of space in all poses",
        settle="look at the named place, or turn the whole setting about the vertical",
        same_shapes=(("point_mass", "a force straight down, always"),),
    ),
    CatalogueEntry(
        "uniform_load", "energy", XYZ,
        lambda c: np.full(3, 0.04 * c.force / c.length),  # two degrees of tilt of the scan frame
        **_plain("force", UniformLoad, 3),
        signature="all poses lean to the same side of space",
        settle="check gravity with a plumb line in the scan frame, and scan once without draught",
        same_shapes=(("gravity", "a tilt of the scan frame, always"),
                     ("length_density", "the part along gravity, as a scale of all stiffnesses")),
    ),
    CatalogueEntry(
        "tether", "energy", ("stiffness", "pull x", "pull y", "pull z"),
        lambda c: np.array([0.3 * c.force / c.length, *(3 * [0.1 * c.force])]),  # a thread that pulls with a tenth
        build=lambda a, site, c: (AnchoredSpring(site["position"], jnp.asarray(c.centre), a[0], a[1:]),),
        to_parameters=_tether_parameters,
        from_parameters=_tether_of,
        sites=_places, one_sided=(True, False, False, False),
        signature="the cable is drawn at one place of it towards one point of space, from whichever side",
        settle="look for a string at the named place",
        same_shapes=(("point_load", "an anchor far away beside the motion of the place between poses"),),
    ),
    CatalogueEntry(
        "support_plane", "energy", ("contact stiffness",),
        lambda c: np.array([20.0 * c.force / c.length**2]),  # N/m^2: its weight at a depth of 5 % of the length
        build=lambda a, site, c: (SupportPlane(jnp.asarray(c.up), site["offset"], a[0]),),
        to_parameters=lambda a, site, c: {"normal": np.asarray(c.up), "offset": float(site["offset"])},
        from_parameters=lambda p, c: (np.array([CONTACT]), {"offset": float(p["offset"])}),
        sites=_levels, one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.array([CONTACT])),
        signature="low poses are flat below one level, poses above it are untouched",
        settle="scan the table along with the cable",
        same_shapes=(("elastic_support", "when every pose lies below the level"),),
    ),
    CatalogueEntry(
        "elastic_support", "energy", ("stiffness",),
        lambda c: np.array([2.0 * c.force / c.length**2]),  # N/m^2: its weight at half the length, a soft curtain
        build=lambda a, site, c: (ElasticSupport(jnp.asarray(c.up), site["offset"], a[0]),),
        to_parameters=lambda a, site, c: {
            "normal": np.asarray(c.up), "offset": float(site["offset"]), "stiffness": float(np.asarray(a)[0]),
        },
        from_parameters=lambda p, c: (np.array([float(p["stiffness"])]), {"offset": float(p["offset"])}),
        sites=_levels, one_sided=(True,),
        signature="all poses are drawn to one level, from above and from below",
        settle="look for what the cable lies in",
    ),
)  # fmt: skip
