"""One module per peer: `prepare(problem, size, **options)` returns a function of no arguments that solves the problem.

That function returns a list of `Found`: relaxation codes come to rest gradually and give one for each tolerance that they
passed on the way, with the processor seconds until then; the others give one. A module is imported in the process that runs
it, so a peer that is not installed costs a sentence.
"""

from importlib.util import find_spec
from typing import NamedTuple

import numpy as np


class Found(NamedTuple):
    """Points (n, 3) m at arc lengths ``s`` (n,) m; ``seconds`` of this process up to here if not all; what is to be told."""

    s: np.ndarray
    points: np.ndarray
    told: dict
    seconds: float | None = None


class Peer(NamedTuple):
    """A program and how it is used: its module here, its library, sizes to run (elements, or tolerances)."""

    name: str
    what: str
    module: str
    library: str
    sizes: tuple
    given: tuple = ()

    @property
    def options(self) -> dict:
        """Options of the module's `prepare`."""
        return dict(self.given)

    def missing(self) -> str | None:
        """Why it cannot be run, in a sentence."""
        if find_spec({"pyelastica": "elastica"}.get(self.library, self.library)) is None:
            return f"{self.library} is not installed: pip install -e '.[peers]'"
        return None


MESHES = (10, 20, 40, 80, 160)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
_ALL = (
    Peer("scan2flex_jax", "mixed Newton from its own generic start", "ours", "jax", MESHES),
    Peer("scan2flex_jax, BFGS", "optimistix BFGS, its reference", "ours", "jax", MESHES[:3], (("solver", "bfgs"),)),
    Peer("solve_bvp", "scipy's collocation of the continuous equations, own mesh", "collocation", "scipy", TOLERANCES),
    Peer("PyElastica", "end elements centred on clamps", "elastica_rod", "pyelastica", MESHES[:3]),
    Peer("MuJoCo flex", "end edges centred on clamps", "mujoco_flex", "mujoco", MESHES[:4]),
)
PEERS = {p.name: p for p in _ALL}
