"""Catalogue entries of loads and of what the cable touches."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial import ConvexHull

from scan2flex_jax.effects._materials import _plain
from scan2flex_jax.effects.catalogue import CatalogueEntry, SameShapes, along_loaded, loaded_places
from scan2flex_jax.effects.elastic_support import ElasticSupport
from scan2flex_jax.effects.increments import AnchoredSpring
from scan2flex_jax.effects.point_load import PointLoad
from scan2flex_jax.effects.point_mass import PointMass
from scan2flex_jax.effects.support_plane import CONTACT, SupportPlane
from scan2flex_jax.effects.uniform_load import UniformLoad

XYZ = ("x", "y", "z")


def _places(c):
    return tuple({"position": s} for s in loaded_places(c))


def _levels(c):
    """Heights of soft supports, from the lowest measured point to a little above the highest of the lowest ones."""
    least, largest = _level_range(c)
    return tuple({"offset": h} for h in np.linspace(least, largest, 13))


def _level_range(c):
    """Least and largest height (m) of a soft support."""
    low, high = c.lowest_range
    margin = 0.02 * c.length
    return low - 0.25 * margin, max(high, low) + 2.0 * margin


def _ground(c):
    """Planes to look at, and a little above and below each: nothing lies below a hard one but for the scanner's noise.

    So it is a facet of the hull of all measured points. Tables are level to some degrees: of the facets that lean less, those
    with most points on them, and the level plane through the lowest point.
    """
    axes = _level_axes(c.up)
    planes = [(0.0, 0.0, c.lowest), *_facets(c, axes)]
    planes += planes[:1] * (_PLANES - len(planes))
    return tuple(
        {"offset": part * c.length, "tilt_1": a, "tilt_2": b, "place": place, "axes": axes}
        for a, b, place in planes for part in _LIFTS
    )  # fmt: skip


_LIFTS, _TILT = (-0.002, 0.0, 0.002, 0.005), 0.2  # of the length, above a plane; tilt from the level: no table is further off
_PLANES, _LEAN, _TOUCHING, _OTHER = 4, 0.12, 0.002, 0.01  # count; tilt; of the length; tilt that makes another plane


def _level_axes(up):
    """Two unit vectors (2, 3) across ``up``."""
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def _facets(c, axes):
    """Lower facets ``(tilt, tilt, a point)`` of the hull of all measured points, those with most points on them first."""
    if len(c.points) < 4:
        return []
    hull = ConvexHull(c.points, qhull_options="QJ")  # joggled: plane poses have no volume
    lower = hull.equations[-hull.equations[:, :3] @ c.up > np.cos(_LEAN)]
    order = sorted(lower, key=lambda e: -np.sum(c.points @ e[:3] + e[3] > -_TOUCHING * c.length))
    out: list = []
    for e in order:
        tilt = axes @ e[:3] / (e[:3] @ c.up)
        touching = c.points[c.points @ e[:3] + e[3] > -_TOUCHING * c.length]
        if all(np.linalg.norm(tilt - other[:2]) > _OTHER for other in out):
            out.append((*tilt, touching.mean(axis=0)))
    return out[: _PLANES - 1]


def _tilts(c):
    return -_TILT, _TILT


def _plane(site, up):
    """Unit normal, and the offset (m) of a plane at a site."""
    lean = up + site["tilt_1"] * site["axes"][0] + site["tilt_2"] * site["axes"][1]
    normal = lean / jnp.linalg.norm(lean)
    return normal, normal @ (site["place"] + site["offset"] * up)


def _table(a, site, c):
    normal, offset = _plane(site, jnp.asarray(c.up))
    return (SupportPlane(normal, offset, a[0]),)


def _plane_parameters(site, c):
    normal, offset = _plane(site, c.up)
    return {"normal": np.asarray(normal), "offset": float(offset)}


def _plane_of(p, c):
    normal, axes = np.asarray(p["normal"], float), _level_axes(c.up)
    steep = normal @ c.up
    tilt, place = axes @ normal / steep, float(p["offset"]) / steep * c.up
    return {"offset": 0.0, "tilt_1": tilt[0], "tilt_2": tilt[1], "place": place, "axes": axes}


_REACH = (0.03, 1.0)  # of the length: from the cable to where a string is anchored
_SOFTEST, _SPREAD = 1.0 / 6.0, 1.5  # of strings: of the size, and of the logarithm of the stiffness in units of the size


def _tether_size(c):
    return np.array([0.3 * c.force / c.length, *(3 * [0.1 * c.force])])  # a thread that pulls with a tenth


def _tether(a, site, c):
    """A spring of rest length zero about the middle of the scans; with a ``reach`` a string, whose stiffness is log-normal."""
    if "reach" not in site:
        return (AnchoredSpring(site["position"], jnp.asarray(c.centre), a[0], a[1:]),)
    k = _string_stiffness(a[0], site["softest"])
    return (AnchoredSpring(site["position"], jnp.asarray(site["place"]), k, a[1:], site["reach"]),)


def _string_stiffness(a, softest):
    return softest * jnp.exp(_SPREAD * a * _SOFTEST / softest)


def _string_amplitude(k, softest):
    return np.log(k / softest) / _SPREAD * softest / _SOFTEST


def _tether_of(p, c):
    """Amplitude and site of a tether."""
    k, anchor, rest = float(p["stiffness"]), np.asarray(p["anchor"], float), float(p.get("rest_length", 0.0))
    if not rest:
        return np.array([k, *(k * (anchor - c.centre))]), {"position": float(p["position"])}
    towards, taut = (anchor - c.centre) / np.linalg.norm(anchor - c.centre), 0.1 * c.length
    softest, place = _SOFTEST * _tether_size(c)[0], anchor - (rest + taut) * towards
    site = {"position": float(p["position"]), "reach": rest + taut, "place": place, "softest": softest}
    return np.array([_string_amplitude(k, softest), *(k * taut * towards)]), site


def _tether_parameters(a, site, c):
    a, position = np.asarray(a, float), float(site["position"])
    if "reach" not in site:
        anchor = c.centre + a[1:] / a[0] if a[0] > 0 else c.centre + a[1:]
        return {"position": position, "anchor": anchor, "stiffness": float(a[0]), "rest_length": 0.0}
    k, tension = float(_string_stiffness(a[0], site["softest"])), float(np.linalg.norm(a[1:]))
    reach = max(float(site["reach"]), tension / k)
    anchor = np.asarray(site["place"]) + reach * a[1:] / max(tension, 1e-300)
    return {"position": position, "anchor": anchor, "stiffness": k, "rest_length": reach - tension / k}


def _strings(a, site, c, places):
    """From a spring of rest length zero to strings that pull alike at the tautest of ``places`` (m): anchored nearer."""
    if "reach" in site or len(places) < 2:
        return []
    pulls = np.asarray(a, float)[1:] - float(a[0]) * (places - c.centre)
    forces = np.linalg.norm(pulls, axis=1)
    tautest = np.argmax(forces)
    pull, tension, place = pulls[tautest], forces[tautest], places[tautest]
    if tension < 1e-3 * c.force:
        return []
    out: list = []
    softest = _SOFTEST * _tether_size(c)[0]
    for reach in (0.2 * c.length, 0.4 * c.length):
        distance = np.linalg.norm(places - place - reach * pull / tension, axis=1)
        slope = np.polyfit(distance - reach, forces, 1)[0]
        k = np.clip(slope, 6.0 * softest, 200.0 * softest)
        moved = {"position": float(site["position"]), "reach": reach, "place": place, "softest": softest}
        out.append((np.array([_string_amplitude(k, softest), *pull]), moved, {}))
    return out


ENTRIES = (
    CatalogueEntry(
        "point_mass", "energy", ("mass",),
        lambda c: np.array([0.15 * c.mass_per_length * c.length]),  # a clip or a ferrite beside the whole cable
        build=lambda a, site, c: (PointMass(site["position"], a[0]),),
        to_parameters=lambda a, site, c: {"position": float(site["position"]), "mass": float(np.asarray(a)[0])},
        from_parameters=lambda p, c: (np.array([float(p["mass"])]), {"position": float(p["position"])}),
        sites=_places, moving={"position": along_loaded}, one_sided=(True,), varies="mass",
        signature="the cable sags towards one place of it, always along gravity",
        settle="look for a clip, a marker or a connector at the named place, or weigh the cable",
        same_shapes=(SameShapes("density_profile", "a span that is short beside the sag"),),
    ),
    CatalogueEntry(
        "point_load", "energy", XYZ,
        lambda c: np.full(3, 0.05 * c.force),  # a lead or a tie that pulls with a twentieth of the weight
        build=lambda a, site, c: (PointLoad(site["position"], a),),
        to_parameters=lambda a, site, c: {"position": float(site["position"]), "force": np.asarray(a)},
        from_parameters=lambda p, c: (np.asarray(p["force"], float), {"position": float(p["position"])}),
        sites=_places, moving={"position": along_loaded},
        signature="the cable is drawn at one place of it, in the same direction of space in all poses",
        settle="look at the named place, or turn the whole setting about the vertical",
        same_shapes=(SameShapes("point_mass", "a force straight down", always=True),),
    ),
    CatalogueEntry(
        "uniform_load", "energy", XYZ,
        lambda c: np.full(3, 0.04 * c.force / c.length),  # two degrees of tilt of the scan frame
        **_plain("force", UniformLoad, 3),
        signature="all poses lean to the same side of space",
        settle="check gravity with a plumb line in the scan frame, and scan once without draught",
        same_shapes=(SameShapes("gravity", "a tilt of the scan frame", always=True),
                     SameShapes("length_density", "the part along gravity, as a scale of all stiffnesses")),
    ),
    CatalogueEntry(
        "tether", "energy", ("stiffness", "pull x", "pull y", "pull z"),
        _tether_size,
        build=_tether,
        to_parameters=_tether_parameters,
        from_parameters=_tether_of,
        sites=_places, one_sided=(True, False, False, False), other_starts=_strings,
        moving={"position": along_loaded, "reach": lambda c: (_REACH[0] * c.length, _REACH[1] * c.length)},
        signature="the cable is drawn at one place of it towards one point of space, from whichever side",
        settle="look for a string at the named place",
        same_shapes=(SameShapes("point_load", "an anchor far away beside the motion of the place between poses"),),
    ),
    CatalogueEntry(
        "support_plane", "energy", ("contact stiffness",),
        lambda c: np.array([20.0 * c.force / c.length**2]),  # N/m^2: its weight at a depth of 5 % of the length
        build=_table,
        to_parameters=lambda a, site, c: _plane_parameters(site, c),
        from_parameters=lambda p, c: (np.array([CONTACT]), _plane_of(p, c)),
        sites=_ground, one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.array([CONTACT])),
        moving={"offset": lambda c: (_LIFTS[0] * c.length, _LIFTS[-1] * c.length), "tilt_1": _tilts, "tilt_2": _tilts},
        start_site=lambda site, noise: {**site, "offset": noise},  # nothing lies below a hard plane but for the noise
        continuation=(20.0, 400.0, 1.0e4),
        signature="low poses are flat below one level, poses above it are untouched",
        settle="scan the table along with the cable",
        same_shapes=(SameShapes("elastic_support", "when every pose lies below the level"),),
    ),
    CatalogueEntry(
        "elastic_support", "energy", ("stiffness",),
        lambda c: np.array([2.0 * c.force / c.length**2]),  # N/m^2: its weight at half the length, a soft curtain
        build=lambda a, site, c: (ElasticSupport(jnp.asarray(c.up), site["offset"], a[0]),),
        to_parameters=lambda a, site, c: {
            "normal": np.asarray(c.up), "offset": float(site["offset"]), "stiffness": float(np.asarray(a)[0]),
        },
        from_parameters=lambda p, c: (np.array([float(p["stiffness"])]), {"offset": float(p["offset"])}),
        sites=_levels, moving={"offset": _level_range}, one_sided=(True,),
        signature="all poses are drawn to one level, from above and from below",
        settle="look for what the cable lies in",
    ),
)  # fmt: skip
