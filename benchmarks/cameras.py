"""Two depth cameras written for `benchmarks.scan_alarms` alone: they share nothing with the package's scanner.

Each ray of a grid is marched to the nearest surface (sphere tracing of a signed distance) of the cable, its clamps and a rod
beside it, within an unseen stretch or two. Then the errors of the camera:

* `structured_light`: a camera and a projector a baseline apart. What the projector does not reach is in shadow; triangulation
  errs by a white noise and by stripes, whose phase error varies slowly over the image, both growing with the squared range.
* `time_of_flight`: one depth per pixel, a mean over the rays of its area, so that pixels on a silhouette lie between the cable
  and what is behind it; noise grows with the squared range, and a depth is read in whole millimetres.

Symbols: lengths in m, angles in rad; ``noise``: standard deviation of a depth at 1 m.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

Distance = Callable[[np.ndarray], np.ndarray]  # signed, of points (n, 3), to a surface
_FINE = 0.1  # of the radius: distance of the spheres that make up the cable
_AROUND = 3.0  # radii: half-width of the strip of rays around the cable
_MARCHES, _HIT = 60, 2e-5  # steps, and m from a surface: a hit
_GRAZING = 0.1  # cosine of the incidence below which no light returns
_STRIPES = 0.2  # RMS error of the stripes over the noise
_WALL = 0.6  # m behind the cable's middle


@dataclass(frozen=True)
class Scene:
    """The cable around ``curve`` (n, 3), what else stands there, and shares of its length that nothing shows."""

    curve: np.ndarray
    radius: float
    others: tuple[Distance, ...] = ()
    unseen: tuple[tuple[float, float], ...] = ()

    def __post_init__(self):
        """Spheres along the cable."""
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.curve, axis=0), axis=1))])
        beads = CubicSpline(s, self.curve)(np.linspace(0.0, s[-1], int(s[-1] / (_FINE * self.radius)) + 2))
        object.__setattr__(self, "beads", beads)
        object.__setattr__(self, "tree", cKDTree(beads))

    def cable(self, x) -> tuple[np.ndarray, np.ndarray]:
        """Distance from the cable, and the share of its length there."""
        away, which = self.tree.query(x)
        return away - self.radius, which / (len(self.beads) - 1)

    def __call__(self, x) -> np.ndarray:
        """Distance from the nearest surface."""
        return np.min([self.cable(x)[0], *(other(x) for other in self.others)], axis=0)


def box(centre, axes, half) -> Distance:
    """A box with ``axes`` in rows and half edges."""

    def distance(x):
        q = np.abs((x - centre) @ np.transpose(axes)) - half
        return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(np.max(q, axis=1), 0.0)

    return distance


def rod(a, b, radius) -> Distance:
    """A straight round rod from ``a`` to ``b``."""
    along = np.subtract(b, a)

    def distance(x):
        t = np.clip((x - a) @ along / (along @ along), 0.0, 1.0)
        return np.linalg.norm(x - a - t[:, None] * along, axis=1) - radius

    return distance


def marched(scene: Scene, eye, rays, most) -> np.ndarray:
    """Range of the first surface along each ray (n,); infinite beyond ``most``."""
    nearest = np.min(np.linalg.norm(scene.beads - eye, axis=1)) - 12 * scene.radius
    t = np.full(len(rays), max(nearest, 0.0))
    done, going = np.zeros(len(rays), bool), np.arange(len(rays))
    for _ in range(_MARCHES):
        d = scene(eye + t[going, None] * rays[going])
        t[going] += np.maximum(d, 0.0)
        done[going[d < _HIT]] = True
        going = going[(d >= _HIT) & (t[going] < most)]
        if not len(going):
            break
    return np.where(done, t, np.inf)


def _view(scene, eye):
    """Axes in rows of an image towards the middle of the cable, the third along the view."""
    ahead = scene.beads.mean(axis=0) - eye
    axes = np.linalg.qr(np.stack([ahead, np.roll(ahead, 1) + 0.1, np.roll(ahead, 2)], axis=1))[0].T
    return np.stack([axes[1], axes[2], axes[0] * np.sign(axes[0] @ ahead)])


def _strip(scene, eye, axes, pixel):
    """Image coordinates (n, 2), in pixels, of those near the cable."""
    local = (scene.beads - eye) @ axes.T
    at = local[:, :2] / local[:, 2:] / pixel
    wide = _AROUND * scene.radius / np.min(local[:, 2]) / pixel + 2.0
    low, high = at.min(axis=0) - wide, at.max(axis=0) + wide
    sides = (np.arange(np.floor(a), np.ceil(b)) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    return grid[cKDTree(at).query(grid, distance_upper_bound=wide)[0] < np.inf]


def _rays(image, axes, pixel):
    rays = np.c_[image * pixel, np.ones(len(image))] @ axes
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _seen(scene, x):
    """Mask of points outside the unseen stretches of the cable."""
    away, at = scene.cable(x)
    hidden = np.any([(at > a) & (at < b) for a, b in scene.unseen], axis=0) if scene.unseen else np.zeros(len(x), bool)
    return ~(hidden & (away < scene.radius))


def _normals(scene, x, step=1e-5):
    g = np.stack([scene(x + step * e) - scene(x - step * e) for e in np.eye(3)], axis=1)
    return g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-12)


def structured_light(rng, scene: Scene, eye, noise: float, points: int = 6000) -> np.ndarray:
    """The cloud of one view."""
    axes, size = _view(scene, eye), np.linalg.norm(scene.beads.mean(axis=0) - eye)
    length = scene.beads.shape[0] * _FINE * scene.radius
    pixel = np.sqrt(2 * scene.radius * length / points) / size
    image = _strip(scene, eye, axes, pixel)
    rays = _rays(image, axes, pixel)
    depth = marched(scene, eye, rays, 2.0 * size + length)
    image, rays, depth = (a[np.isfinite(depth)] for a in (image, rays, depth))
    x = eye + depth[:, None] * rays
    normals = _normals(scene, x)
    projector = eye + 0.2 * size * axes[0]
    light = x - projector
    far = np.linalg.norm(light, axis=1)
    light /= far[:, None]
    lit = marched(scene, projector, light, 2.0 * size + length) > far - 1e-3
    lit &= (np.sum(normals * rays, axis=1) < -_GRAZING) & (np.sum(normals * light, axis=1) < -_GRAZING) & _seen(scene, x)
    phase = np.sqrt(2.0) * np.sin(image @ rng.normal(size=2) * 2 * np.pi / rng.uniform(20, 80) + rng.uniform(0, 2 * np.pi))
    error = depth**2 * (noise * rng.normal(size=len(depth)) + _STRIPES * noise * phase)
    stray = rng.uniform(size=len(depth)) < 0.005
    error = np.where(stray, rng.normal(size=len(depth)) * 0.03, error)
    return (x + error[:, None] * rays)[lit]


def time_of_flight(rng, scene: Scene, eye, noise: float, pixel: float = 1 / 600) -> np.ndarray:
    """The cloud of one view."""
    axes, size = _view(scene, eye), np.linalg.norm(scene.beads.mean(axis=0) - eye)
    image = _strip(scene, eye, axes, pixel)
    depths = []
    for offset in np.array([(0, 0), (1, 0), (0, 1), (1, 1)]) / 2 - 0.25:
        depth = marched(scene, eye, _rays(image + offset, axes, pixel), size + _WALL + 1.0)
        depths.append(np.where(np.isfinite(depth), depth, size + _WALL))
    depth, wall = np.mean(depths, axis=0), np.mean(np.array(depths) >= size + _WALL, axis=0)
    rays = _rays(image, axes, pixel)
    kept = (wall <= 0.5) & _seen(scene, eye + depth[:, None] * rays)  # most of a pixel is background: its return is the wall's
    depth = depth + noise * depth**2 * rng.normal(size=len(depth))
    depth = np.where(rng.uniform(size=len(depth)) < 0.01, depth + rng.normal(size=len(depth)) * 0.05, depth)
    return (eye + (np.round(depth / 1e-3) * 1e-3)[:, None] * rays)[kept]
