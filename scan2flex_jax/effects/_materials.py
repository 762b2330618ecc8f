"""Catalogue entries of the material: rest shape, bending law, places of other stiffness or density."""

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.effects.bend_twist_coupling import BendTwistCoupling
from scan2flex_jax.effects.catalogue import CatalogueEntry, SameShapes, along_cable, positions
from scan2flex_jax.effects.density_profile import DensityProfile
from scan2flex_jax.effects.density_taper import DensityTaper
from scan2flex_jax.effects.increments import AxialCompliance, BendingSplit
from scan2flex_jax.effects.kink import Kink
from scan2flex_jax.effects.memory_set import MemorySet
from scan2flex_jax.effects.natural_curvature import NaturalCurvature
from scan2flex_jax.effects.nonlinear_bending import NonlinearBending
from scan2flex_jax.effects.stiffness_profile import StiffnessProfile
from scan2flex_jax.effects.stiffness_taper import StiffnessTaper
from scan2flex_jax.effects.tension_stiffening import TensionStiffening
from scan2flex_jax.effects.tension_twist_coupling import TensionTwistCoupling

AXES = ("about d1", "about d2", "about d3")


def _plain(name, cls, *shape):
    """``build``, ``to_parameters`` and ``from_parameters`` of a kind whose one parameter is the amplitude itself."""

    def value(a):
        return np.asarray(a).reshape(shape) if shape else float(np.asarray(a)[0])

    return {
        "build": lambda a, site, context: (cls(a.reshape(shape)),),
        "to_parameters": lambda a, site, context: {name: value(a)},
        "from_parameters": lambda p, context: (np.asarray(p[name], float).reshape(-1), {}),
    }


_WIDTHS = (0.08, 0.18, 0.35)  # of the length: of the spans to scan
_BENDS = (0.02, 0.12)  # of the length: of the set bends to scan
_SLIPS = np.geomspace(0.1, 2.0, 7)  # of the largest curvature: where slipping begins, to scan
_LOOSE = 0.5  # part of the bending stiffness that slipping takes away
_STRONG = 0.5  # of a logarithm: spans that differ less are told from each other by their signatures


def _span(cls, varies, carried):
    """The same for a span whose amplitude is the logarithm of its factor; ``carried(factor)``: what it has more per length."""

    def other_widths(a, site, c, places):
        """From a strong span that a refit ended at to spans of other widths that carry as much in all."""
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
        "varies": varies,
        "moving": {"position": along_cable, "width": lambda c: (0.5 * (_WIDTHS[0] * c.length), 1.5 * (_WIDTHS[-1] * c.length))},
        "other_starts": other_widths,
        "amplitudes": ("log factor",),
        "build": lambda a, site, context: (cls(site["position"], site["width"], jnp.exp(a[0])),),
        "to_parameters": lambda a, site, context: {**_floats(site), "factor": float(np.exp(a[0]))},
        "from_parameters": lambda p, context: (
            np.log([float(p["factor"])]),
            {"position": float(p["position"]), "width": float(p["width"])},
        ),
        "sites": lambda c: tuple(
            {"position": s, "width": w * c.length} for w in _WIDTHS for s in positions(c, 17)
        ),
        "bounds_of": lambda c: (np.log([0.05]), np.log([20.0])),
    }


def _floats(site):
    return {name: float(x) for name, x in site.items()}


def _most_bent(c):
    """The largest curvature (1/m) of the shapes; a little one where they are straight."""
    return max(c.curvature_range[1], 0.1 / c.length)


def _loose_wires(a, site, c, places):
    """From a bending law that softens much to one of stiff cores that slip early, as stiff where the cable is bent most."""
    most = _most_bent(c)

    def secant(lost, slip):
        return 1.0 - lost + lost * min(slip / most, 1.0)

    if a[0] < _LOOSE:
        return []
    early = {"slip_curvature": 0.2 * most}
    return [(np.array([0.9]), early, {"bending_stiffness": secant(a[0], site["slip_curvature"]) / secant(0.9, 0.2 * most)})]


def _split(parameters):
    """Amplitudes of `BendingSplit`."""
    angle = 2.0 * float(parameters["angle"])
    return np.log(float(parameters["ratio"])) * np.array([np.cos(angle), np.sin(angle)])


ENTRIES = (
    CatalogueEntry(
        "natural_curvature", "energy", AXES,
        lambda c: np.full(3, 0.5 / c.length),  # off a drum a cable keeps an arc of some thirty degrees in its length
        **_plain("curvature", NaturalCurvature, 3),
        signature="a bow out of the plane of the pose, alike all along, that turns over when both clamps are rolled",
        settle="scan one pose again with both clamps rolled by 180 degrees, or with one end free",
        same_shapes=(
            SameShapes("clamp_rotation", "the part about d3 (natural twist) and a roll of one clamp", always=True),
            SameShapes("kink", "the part about d3 (natural twist) and a twist at one place", always=True),
            SameShapes("bend_twist_coupling", "in fewer than four poses, or in poses that lie in one plane"),
        ),
    ),
    CatalogueEntry(
        "kink", "energy", AXES,
        lambda c: np.full(3, 0.15),  # rad: a cable bent by hand keeps five to ten degrees
        build=lambda a, site, c: (Kink(site["position"], a, site["width"]),),
        to_parameters=lambda a, site, c: {
            "position": float(site["position"]), "angle": np.asarray(a), "width": float(site["width"]),
        },
        from_parameters=lambda p, c: (
            np.asarray(p["angle"], float), {"position": float(p["position"]), "width": float(p["width"])},
        ),
        sites=lambda c: tuple({"position": s, "width": w * c.length} for w in _BENDS for s in positions(c)),
        moving={"position": along_cable, "width": lambda c: (0.5 * (_BENDS[0] * c.length), 1.5 * (_BENDS[-1] * c.length))},
        bounds_of=lambda c: (np.full(3, -3.0), np.full(3, 3.0)),
        signature="a corner at the same place of the cable in all poses that turns with the cable",
        settle="look at the named place, or scan with both clamps rolled by 180 degrees",
        same_shapes=(SameShapes("clamp_rotation", "a kink at a clamp"),),
    ),
    CatalogueEntry(
        "anisotropic_bending", "energy", ("log ratio cos 2 angle", "log ratio sin 2 angle"),
        lambda c: np.full(2, 0.2),  # twenty per cent: a braid or an imperfectly round core; flat cables have more
        build=lambda a, site, c: (BendingSplit(a),),
        to_parameters=lambda a, site, c: {
            "ratio": float(np.exp(np.hypot(a[0], a[1]))), "angle": float(0.5 * np.arctan2(a[1], a[0])),
        },
        from_parameters=lambda p, c: (_split(p), {}),
        rescaled=lambda a, site, c: {"bending_stiffness": float(np.exp(-0.5 * np.hypot(a[0], a[1])))},
        bounds_of=lambda c: (np.full(2, -4.0), np.full(2, 4.0)),
        signature="a sideways shift that changes with the roll of the cable and comes back after 180 degrees",
        settle="scan one pose with both clamps rolled by 45 and by 90 degrees",
    ),
    CatalogueEntry(
        "bend_twist_coupling", "energy", ("with d1", "with d2"),
        lambda c: np.full(2, 0.1),  # of sqrt(EI GJ): what the lay of a stranded core gives
        **_plain("coupling", BendTwistCoupling, 2), bounds_of=lambda c: (np.full(2, -0.7), np.full(2, 0.7)),
        signature="bending turns the cable out of its plane, the more the stronger it is bent",
        settle="scan one pose with both clamps rolled by 180 degrees, and one almost straight with a free end",
        same_shapes=(SameShapes("natural_curvature", "in fewer than four poses of like curvature"),),
    ),
    CatalogueEntry(
        "nonlinear_bending", "energy", ("1 - ratio",),
        lambda c: np.array([0.5]),  # between a slight slip and loose wires, both of which are common
        build=lambda a, site, c: (NonlinearBending(site["slip_curvature"], 1.0 - a[0]),),
        to_parameters=lambda a, site, c: {
            "slip_curvature": float(site["slip_curvature"]), "ratio": 1.0 - float(np.asarray(a)[0]),
        },
        from_parameters=lambda p, c: (
            np.array([1.0 - float(p["ratio"])]), {"slip_curvature": float(p["slip_curvature"])},
        ),
        sites=lambda c: tuple({"slip_curvature": k} for k in _SLIPS * _most_bent(c)),
        moving={"slip_curvature": lambda c: (0.2 * (_SLIPS[0] * _most_bent(c)), _SLIPS[-1] * _most_bent(c))},
        one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.ones(1)), other_starts=_loose_wires,
        signature="strongly bent poses look softer than gently bent ones; the misfit sits where the cable is bent most",
        settle="scan poses whose largest curvature is well below and well above the slip curvature",
        same_shapes=(SameShapes("bending_stiffness", "a slip curvature far above or far below all curvatures"),),
    ),
    CatalogueEntry(
        "stiffness_profile", "energy", size=lambda c: np.array([0.5]),  # a sleeve, a worn place: 0.6 to 1.6
        **_span(StiffnessProfile, "stiffness", lambda factor: 1.0 / factor - 1.0),  # compliances add
        signature="one span bends less (or more) than it should in every pose",
        settle="look and feel at the named span, or bring it to where the cable is bent most",
        same_shapes=(SameShapes("elastic_clamp", "a span at a clamp"),
                     SameShapes("length_error", "a stiff span that begins at a clamp")),
    ),
    CatalogueEntry(
        "density_profile", "energy", size=lambda c: np.array([0.5]),  # a sleeve, or water in a hose
        **_span(DensityProfile, "mass", lambda factor: factor - 1.0),
        signature="one span sags as if it were heavier (or lighter), always along gravity",
        settle="weigh or look at the named span",
        same_shapes=(SameShapes("point_mass", "a span that is short beside the sag"),),
    ),
    CatalogueEntry(
        "stiffness_taper", "energy", ("taper",),
        lambda c: np.array([0.2]),  # ends that differ in stiffness by half
        **_plain("taper", StiffnessTaper), varies="stiffness", bounds_of=lambda c: (np.full(1, -2.0), np.full(1, 2.0)),
        signature="one half of the cable bends more than the other, whichever way round it hangs",
        settle="swap the two ends of the cable in one pose",
    ),
    CatalogueEntry(
        "density_taper", "energy", ("taper",),
        lambda c: np.array([0.15]),  # ends that differ in weight by a third
        **_plain("taper", DensityTaper), varies="mass", bounds_of=lambda c: (np.full(1, -2.0), np.full(1, 2.0)),
        signature="the lowest point lies towards one end of the cable, whichever way round it hangs",
        settle="find the cable's centre of mass on an edge",
    ),
    CatalogueEntry(
        "extensibility", "energy", ("compliance",),
        lambda c: np.array([0.01 / c.force]),  # one per cent longer under its own forces: soft plastic, a loose braid
        build=lambda a, site, c: (AxialCompliance(a[0]),),
        to_parameters=lambda a, site, c: {
            "axial_stiffness": c.axial_stiffness / (1.0 + float(np.asarray(a)[0]) * c.axial_stiffness),
        },
        from_parameters=lambda p, c: (np.array([1.0 / float(p["axial_stiffness"]) - 1.0 / c.axial_stiffness]), {}),
        one_sided=(True,),
        signature="tight poses are longer than slack ones",
        settle="scan one pose with the clamps pulled apart until the cable is nearly straight",
        same_shapes=(SameShapes("length_error", "when the tension is alike in all poses"),),
    ),
    CatalogueEntry(
        "tension_twist_coupling", "energy", ("lever",),
        lambda c: np.array([0.1 * c.radius_or_guess]),  # a tenth of the radius: a cable of one lay, half a rope
        **_plain("lever", TensionTwistCoupling),
        signature="tight poses are twisted, slack ones are not",
        settle="hang the cable with a weight at its free end and watch the end turn",
        same_shapes=(SameShapes("clamp_rotation", "when the tension is alike in all poses, for a roll"),),
    ),
    CatalogueEntry(
        "tension_stiffening", "energy", ("gain",),
        lambda c: np.array([c.radius_or_guess**2]),  # wires that lie at the radius
        **_plain("gain", TensionStiffening), one_sided=(True,),
        signature="tight poses bend less than slack ones, and bent ones are shorter",
        settle="scan poses whose tension differs threefold",
    ),
    CatalogueEntry(
        "memory_set", "energy", ("memory",),
        lambda c: np.array([0.15]),  # plastics keep ten to twenty per cent over minutes
        build=lambda a, site, c: (MemorySet(a[0], c.previous),),
        to_parameters=lambda a, site, c: {"memory": float(np.asarray(a)[0])},
        from_parameters=lambda p, c: (np.array([float(p["memory"])]), {}),
        one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.ones(1)),
        signature="each pose leans towards the shape of the pose before it",
        settle="repeat the first pose at the end, and take the poses in another order",
    ),
)  # fmt: skip
