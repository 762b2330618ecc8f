"""Gradient and Hessian of the potential energy, block by block along the chain of nodes.

Coordinates are body twists ``eta_i`` of the nodes, ``g_i exp(eta_i)``. For an element with helix ``x = log(g0^-1 g1)`` and
twists ``a, b`` of its ends, to second order,

    log(exp(-a) exp(x) exp(b)) = x + T c - 1/2 T [A a, b] + 1/2 d(T)[..],   c = b - A a,

with ``A = Ad(exp(-x))`` and ``T`` the inverse right Jacobian (`geometry.lie`). All terms are therefore 6x6 per element: the
wrench ``p = T' n`` at the far end, the material stiffness ``S = T' K T / ds``, the geometric stiffness ``Q`` (from ``dT/dx``
at fixed section force ``n``) and the antisymmetric part of the bracket. Tests compare these blocks with `jax.grad` and
`jax.hessian` of the energy.

The geometric stiffness is taken at given section forces. Those of the current strains give Newton's method; those
predicted by the last step give the mixed (stress-strain) method (Magisano, Leonetti, Garcea 2017), which does not stall in
the narrow energy valley of a nearly inextensible rod.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import cross, diagonal_matrix, matmul, matvec, vecmat
from scan2flex_jax.rod.effect import Node
from scan2flex_jax.rod.element_law import element_forces, element_stiffness, tension_stiffness
from scan2flex_jax.rod.energy import (
    E3,
    displaced,
    element_potential,
    elements,
    node_potential,
    node_weights,
    nudged,
    strains,
    supported,
)
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.rod.support import AbstractSupport, Springs, springs, supports


class Elements(NamedTuple):
    """Per element: helix ``x`` (m, rad), section force and moment ``n`` in material axes (N, N m), tangent stiffness ``K``,
    and the maps ``T``, ``A`` from end twists to strain increments."""

    x: Float[Array, "n 6"]
    n: Float[Array, "n 6"]
    K: Float[Array, "n 6 6"]
    T: Float[Array, "n 6 6"]
    A: Float[Array, "n 6 6"]


class Derivatives(NamedTuple):
    """Gradient (N, N m) and Hessian blocks: ``diagonal[i]`` of node i, ``upper[i]`` between nodes i and i+1.

    Rows and columns of held motions are eliminated; ``ends`` keeps the original blocks ``(diagonal, upper)`` of the first and
    of the last node and element. ``springs``: of a rod with supports.
    """

    gradient: Float[Array, "nodes 6"]
    diagonal: Float[Array, "nodes 6 6"]
    upper: Float[Array, "nodes-1 6 6"]
    ends: Float[Array, "2 2 6 6"]
    elements: Elements
    springs: Springs | None = None


def no_derivatives(rod: Rod) -> Derivatives:
    """Zeros in the shape of `derivatives`, written out: finding it by tracing took a third of the tracing of a solve."""
    n = rod.elements

    def zeros(*shape):
        return jnp.zeros(shape, rod.section.ds.dtype)

    each, held = Elements(zeros(n, 6), zeros(n, 6), zeros(n, 6, 6), zeros(n, 6, 6), zeros(n, 6, 6)), len(supports(rod))
    still = Springs(zeros(held, n, 3), zeros(held, n, 3, 12), None, zeros()) if held else None
    return Derivatives(zeros(n + 1, 6), zeros(n + 1, 6, 6), zeros(n, 6, 6), zeros(2, 2, 6, 6), each, still)


def section_forces(rod: Rod, configuration: Configuration) -> Float[Array, "n 6"]:
    """Force and moment of each element in material axes (N, N m); paper, Eq. 3."""
    return element_forces(rod, strains(rod, configuration) - rod.section.natural)


def free_motions(rod: Rod) -> Float[Array, "nodes 6"]:
    """1 for each motion that no support holds, 0 for the others."""
    free = jnp.ones((rod.elements + 1, 6))
    return free.at[0].set(1.0 - rod.boundary.held[0]).at[-1].set(1.0 - rod.boundary.held[1])


def out_of_balance(rod: Rod, configuration: Configuration) -> Float[Array, "nodes 6"]:
    """Gradient of the energy in body twists of all nodes; at a support it is the reaction (N, N m)."""
    return node_forces(rod, supported(rod, configuration))


def node_forces(rod: Rod, configuration: Configuration) -> Float[Array, "nodes 6"]:
    """`out_of_balance` of a configuration whose ends are at the supports."""
    c = configuration
    n = section_forces(rod, c)
    r, R = c

    def element(r0, R0, r1, R1, n):
        d, D = vecmat(r1 - r0, R0), matmul(R0.T, R1)
        x = lie.se3_log(d, D)
        # T' n at the far end and -(T A)' n at the near one, where T A is the inverse left Jacobian. A dot: the tangent of a sum
        # by n alone would recompute the Jacobians for each entry of n (`geometry.small`)
        return n @ lie.right_jacobian_inverse(-x), n @ lie.right_jacobian_inverse(x)

    near, far = jax.vmap(element)(r[:-1], R[:-1], r[1:], R[1:], n)
    return to_nodes(-near, far) + _outer_gradient(rod, c)


def derivatives(
    rod: Rod,
    configuration: Configuration,
    damping: Float[Array, "6 6"] | None = None,
    predict: Callable = lambda n: n,
    pull: Callable = lambda force: force,
) -> Derivatives:
    """Gradient and Hessian blocks at a supported configuration.

    ``predict`` maps the section forces of the strains (N, N m) to those of the geometric stiffness; ``damping`` is added
    to the tangent stiffness of all sections in the Hessian only. ``pull`` does for the
    forces of supports (N) what ``predict`` does for sections. Held motions are eliminated: zero gradient, unit diagonal.
    """
    c = configuration
    strain = strains(rod, c)
    excess = strain - rod.section.natural
    n, K = element_forces(rod, excess), element_stiffness(rod, excess)
    x, predicted = rod.section.ds * (strain + jnp.array(E3)), predict(n)
    K = K + tension_stiffness(rod, n[:, 2], predicted[:, 2])
    T, A, p, stiffness, bracket = _element_blocks(rod, c, x, n, K if damping is None else K + damping, predicted)
    At = jnp.swapaxes(A, 1, 2)
    near = matmul(At, stiffness)
    diagonal = to_nodes(matmul(near, A), stiffness)
    upper = -(near + 0.5 * matmul(At, bracket))
    held = springs(rod, c, bends=True) if supports(rod) else None
    gradient = to_nodes(-matvec(At, p), p) + _outer_gradient(rod, c, held)
    diagonal = diagonal + _outer_hessian(rod, c)
    between = _between(rod, c)
    blocks = [] if between is None else [jax.vmap(jax.hessian(between[0]))(*between[1])]
    blocks += [] if held is None else [held.hessian(pull(held.forces()))]
    for block in blocks:
        diagonal, upper = diagonal + to_nodes(block[:, :6, :6], block[:, 6:, 6:]), upper + block[:, :6, 6:]
    free, ends = free_motions(rod), jnp.stack([jnp.stack([diagonal[i], upper[i]]) for i in (0, -1)])
    diagonal = diagonal * free[:, :, None] * free[:, None, :] + diagonal_matrix(1.0 - free)
    upper = upper * free[:-1, :, None] * free[1:, None, :]
    held = None if held is None else held._replace(bend=None)
    return Derivatives(gradient * free, diagonal, upper, ends, Elements(x, n, K, T, A), held)


def strain_increment(rod: Rod, elements: Elements, twist: Float[Array, "nodes 6"]) -> Float[Array, "n 6"]:
    """First-order change of the strains (-, 1/m) when the nodes move by ``twist``."""
    near = matvec(elements.A, twist[:-1])
    return matvec(elements.T, twist[1:] - near) / rod.section.ds


def _element_blocks(rod, c, x, n, K, forces):
    ds = rod.section.ds

    def element(r0, R0, r1, R1, x, n, K, m):
        d, D = vecmat(r1 - r0, R0), matmul(R0.T, R1)
        T = lie.right_jacobian_inverse(x)
        P = lie.right_jacobian_inverse_slope(x, m) @ T  # a dot: see `geometry.small`
        stiffness = matmul(T.T, K / ds, T) + 0.5 * (P + P.T)
        return T, lie.adjoint_inverse(d, D), vecmat(n, T), stiffness, lie.bracket_matrix(vecmat(m, T))

    r, R = c
    return jax.vmap(element)(r[:-1], R[:-1], r[1:], R[1:], x, n, K, forces)


def to_nodes(near, far):
    """Sum at each node of the far-end term of the element before it and the near-end term of the element after it."""
    pad = jnp.zeros((1, *near.shape[1:]), near.dtype)
    return jnp.concatenate([near, pad]) + jnp.concatenate([pad, far])


def _outer_gradient(rod, c, held=None):
    f, q = _material_loads(rod, c)
    dead = -jnp.concatenate([f, cross(jnp.array(E3[:3]), q)], axis=1)
    between = _between(rod, c)
    blocks = [] if between is None else [jax.vmap(jax.grad(between[0]))(*between[1])]
    held = springs(rod, c) if held is None and supports(rod) else held
    blocks += [] if held is None else [held.gradient]
    for block in blocks:
        dead = dead + to_nodes(block[:, :6], block[:, 6:])
    field = _outer_field(rod, c)
    return dead if field is None else dead + jax.vmap(jax.grad(field[0]), in_axes=(0, 0))(*field[1])


def _outer_hessian(rod, c):
    f, q = _material_loads(rod, c)
    e3, eye = jnp.array(E3[:3]), np.eye(3)

    def node(f, q):  # second-order terms of -f.(v + w x v / 2) - q.(w x (w x e3)) / 2
        vw = -0.5 * lie.hat(f)
        ww = q[2] * eye - 0.5 * (jnp.outer(e3, q) + jnp.outer(q, e3))
        return jnp.block([[jnp.zeros((3, 3)), vw], [vw.T, ww]])

    dead = jax.vmap(node)(f, q)
    field = _outer_field(rod, c)
    return dead if field is None else dead + jax.vmap(jax.hessian(field[0]), in_axes=(0, 0))(*field[1])


def _material_loads(rod, c):
    return tuple(vecmat(x, c.R) for x in (rod.load.force, rod.load.lever))


def _between(rod, c):
    """Energy of one element that loads give to it, as a function of the twists of its nodes (from zero), with the arguments to
    map over; None without any. Supports are apart (`rod.support.springs`)."""
    potential = element_potential(rod, [e for e in rod.effects if not isinstance(e, AbstractSupport)])
    if potential is None:
        return None

    def energy(twist, element):
        return potential(nudged(element, twist))

    return energy, (jnp.zeros((rod.elements, 12)), elements(rod, c))


def _outer_field(rod, c):
    """Energy of one node as a function of its twist (from zero), with the arguments to map over; None without outer field."""
    potential = node_potential(rod)
    if potential is None:
        return None

    def energy(twist, node):
        r, R, s, w = node
        return potential(Node(*displaced(r, R, twist), s, w, rod.section.ds, rod.boundary))

    return energy, (jnp.zeros((rod.elements + 1, 6)), (c.r, c.R, rod.node_s, node_weights(rod)))
