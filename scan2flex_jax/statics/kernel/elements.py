"""C++ of the arithmetic of one element and of one node, translated from the package's own functions, for CPU and GPU.

The energy of a rod is the sum over its elements, so its gradient and Hessian are sums of those of rods of one element: the
functions below apply `rod.assembly.derivatives` and others to such a rod, without supports. A node's load counts in the element
before it. Translated (`symbolic`), each function works on numbers of type ``lanes``: those of eight elements or nodes on a CPU
(`lanes.h`), one on a GPU (`settle.cu`).
"""

from collections import defaultdict
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import matmul, matvec, vecmat
from scan2flex_jax.rod.assembly import Elements, derivatives, section_forces, strain_increment
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import Section
from scan2flex_jax.rod.energy import retract
from scan2flex_jax.rod.loads import DeadLoad
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics import blocktridiagonal, newton
from scan2flex_jax.statics.kernel.symbolic import Graph, traced
from scan2flex_jax.statics.newton import lent_forces, stiffened

_CONSTANTS = ("_LONGEST", "_PUSH", "_SETTLED", "_LEFT", "_HOLD", "_FIRST", "_GROW", "_SHRINK", "_NONE")
_SECTION = {"ds": (), "stiffness": (1, 6, 6), "natural": (1, 6), "within": (1, 3, 3)}
_FRAMES = {"r": (2, 3), "R": (2, 3, 3)}


class Routine(NamedTuple):
    """A function of arrays by name, with their shapes, and the names of what it returns."""

    name: str
    function: Callable
    inputs: dict[str, tuple[int, ...]]
    outputs: tuple[str, ...]


def _rod(ds, stiffness, natural, within, force=None, lever=None):
    nothing = jnp.zeros((2, 3))
    load = DeadLoad(nothing if force is None else force, nothing if lever is None else lever)
    section = Section(jnp.zeros(1), ds, stiffness, natural, jnp.zeros(1), within)
    return Rod(section, load, Boundary(nothing, jnp.zeros((2, 3, 3)), jnp.zeros((2, 6))), ())


def _stiffened(within, own):
    rod = _rod(jnp.ones(()), jnp.zeros((1, 6, 6)), jnp.zeros((1, 6)), within)
    stiffness, of_law = stiffened(rod, own > 0.0)
    return stiffness, jnp.where(of_law, 1.0, 0.0)


def _forces(ds, stiffness, natural, within, r, R):
    return section_forces(_rod(ds, stiffness, natural, within), Configuration(r, R))


def _element(ds, stiffness, natural, within, r, R, force, lever, forces, of_strains, stretching, lent, lendable, mode):
    rod, turning = _rod(ds, stiffness, natural, within, force, lever), jnp.diag(jnp.array(newton._ROTATION))
    kept = jnp.concatenate([jnp.full(3, stretching), jnp.ones(3)])
    d = derivatives(
        rod, Configuration(r, R), lent * lendable * turning, lambda n: jnp.where(of_strains > 0.0, n * kept, forces)
    )
    return *d.elements, d.gradient, d.diagonal, d.upper, lent_forces(rod, lendable * turning, d.elements, mode)


def _predicted(ds, r, R, x, n, K, twist):
    T, A = lie.right_jacobian_inverse(x[0]), lie.adjoint_inverse(vecmat(r[1] - r[0], R[0]), matmul(R[0].T, R[1]))
    increment = strain_increment(_rod(ds, K, n, jnp.zeros((1, 3, 3))), Elements(x, n, K, T[None], A[None]), twist)
    return n + matvec(K, increment)


def _moved(r, R, twist):
    return tuple(retract(Configuration(r, R), twist))


_LOADS = {"force": (2, 3), "lever": (2, 3)}
_STEP = {"forces": (1, 6), "of_strains": (), "stretching": (), "lent": (), "lendable": (), "mode": (2, 6)}
ROUTINES = (
    Routine("stiffened", _stiffened, {"within": (1, 3, 3), "own": ()}, ("within", "own")),
    Routine("section_forces", _forces, _SECTION | _FRAMES, ("n",)),
    Routine(
        "element", _element, _SECTION | _FRAMES | _LOADS | _STEP,
        ("x", "n", "K", "T", "A", "gradient", "diagonal", "upper", "followed"),
    ),
    Routine(
        "predicted_forces", _predicted, {"ds": ()} | _FRAMES | {"x": (1, 6), "n": (1, 6), "K": (1, 6, 6), "twist": (2, 6)},
        ("forces",),
    ),
    Routine("moved", _moved, {"r": (1, 3), "R": (1, 3, 3), "twist": (1, 6)}, ("r", "R")),
)  # fmt: skip

_INFIX = {"add": "+", "sub": "-", "mul": "*", "lt": "<", "gt": ">", "le": "<=", "ge": ">=", "eq": "==", "ne": "!=",
          "and": "&", "or": "|"}  # fmt: skip


def source() -> str:
    """The C++ of all routines: for each a namespace with the places of its inputs and outputs, and a function ``run``."""
    return "\n".join(_translated(routine) for routine in ROUTINES)


def constants() -> str:
    """The C++ of the constants of the method."""
    named = {name[1:]: getattr(newton, name) for name in _CONSTANTS} | {"NEUTRAL": blocktridiagonal._NEUTRAL}
    return "".join(f"constexpr double {name} = {value!r};\n" for name, value in named.items())


def _translated(routine):
    graph, first, places = Graph(), 0, []
    inputs = []
    for name, shape in routine.inputs.items():
        count = int(np.prod(shape))
        places.append(f"constexpr int {name} = {first};")
        inputs.append(np.array([graph.input(first + i) for i in range(count)], int).reshape(shape))
        first += count
    found = traced(graph, routine.function, tuple(inputs))
    results = np.concatenate([x.ravel() for x in found]).tolist()
    second, outputs = 0, []
    for name, nodes in zip(routine.outputs, found, strict=True):
        outputs.append(f"constexpr int {name} = {second};")
        second += nodes.size
    return "\n".join(
        [f"namespace {routine.name} {{", "namespace in {", *places, f"constexpr int size = {first};", "}", "namespace out {",
         *outputs, f"constexpr int size = {second};", "}",
         "template <class In, class Out> INLINE void run(In in, Out out) {", *_statements(graph, results), "}", "}"]
    )  # fmt: skip


def _statements(graph, results):
    """One statement for each node that a result depends on; each result as soon as it is known."""
    needed, open_, places = set(), list(set(results)), defaultdict(list)
    while open_:
        index = open_.pop()
        if index not in needed:
            needed.add(index)
            if graph.nodes[index].operation not in ("const", "input"):
                open_ += graph.nodes[index].arguments
    for place, index in enumerate(results):
        places[index].append(place)
    lines = []
    for i in sorted(needed):
        if graph.nodes[i].operation != "const":
            kind = "truths" if graph.is_truth(i) else "lanes"
            lines.append(f"const {kind} v{i} = {_expression(graph, graph.nodes[i])};")
        lines += [f"out[{place}] = {_operand(graph, i)};" for place in places[i]]
    return lines


def _expression(graph, node):
    if node.operation == "input":
        return f"in[{node.arguments[0]}]"
    x = [_operand(graph, a) for a in node.arguments]
    if node.operation == "select":
        return f"{x[0]} ? {x[2]} : {x[1]}"
    if node.operation in _INFIX:
        return f"{x[0]} {_INFIX[node.operation]} {x[1]}"
    if node.operation in ("neg", "not"):
        return f"{'-' if node.operation == 'neg' else '!'}{x[0]}"
    return f"lanes_{node.operation}({', '.join(x)})"


def _operand(graph, index):
    value = graph.value(index)
    if value is None:
        return f"v{index}"
    return f"all({str(value).lower()})" if isinstance(value, bool) else f"all({value!r})"
