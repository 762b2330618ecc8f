"""A traced JAX function as straight-line arithmetic: its jaxpr, evaluated on arrays whose entries are symbols.

Small matrices that are partly constant (cross-product matrices, zero blocks, unit vectors) cost nothing this way: operations
that only move entries leave no trace, products with 0 and 1 vanish, and an expression that occurs twice is computed once.
"""

from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from scan2flex_jax.errors import Scan2FlexError

_NUMPY = {
    "neg": np.negative, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos, "tan": np.tan, "abs": np.abs, "not": np.logical_not,
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide, "max": np.maximum, "min": np.minimum,
    "atan2": np.arctan2, "lt": np.less, "gt": np.greater, "le": np.less_equal, "ge": np.greater_equal, "eq": np.equal,
    "ne": np.not_equal, "and": np.logical_and, "or": np.logical_or,
}  # fmt: skip
_ALIASES = {"add_any": "add"}
_COMMUTATIVE = {"add", "mul", "and", "or"}
_TRUTHS = {"lt", "gt", "le", "ge", "eq", "ne", "and", "or", "not"}
_TOTALS = {"reduce_sum": ("add", 0.0), "reduce_max": ("max", -np.inf), "reduce_and": ("and", True), "reduce_or": ("or", False)}
_PLACED = {  # operations that move entries and have indices among their operands: from which one on, up to which
    "gather": (1, 2), "scatter": (1, 2), "dynamic_slice": (1, None), "dynamic_update_slice": (2, None),
}  # fmt: skip
_MOVES = {"pad", "rev", "split", "stack", "unstack", *_PLACED}
_SHAPED = {  # those that numpy knows, where a call of JAX takes milliseconds
    "reshape": lambda p, x: x.reshape(p["new_sizes"]),
    "transpose": lambda p, x: x.transpose(p["permutation"]),
    "squeeze": lambda p, x: x.squeeze(tuple(p["dimensions"])),
    "slice": lambda p, x: x[tuple(map(slice, p["start_indices"], p["limit_indices"], p["strides"] or [1] * x.ndim))],
    "concatenate": lambda p, *x: np.concatenate(x, p["dimension"]),
    "broadcast_in_dim": lambda p, x: _broadcast(x, p["shape"], p["broadcast_dimensions"]),
}
_CALLS = ("jaxpr", "call_jaxpr", "fun_jaxpr")


class Node(NamedTuple):
    """One operation on earlier nodes; ``const`` has its type and value in place of arguments, ``input`` its position."""

    operation: str
    arguments: tuple


class Graph:
    """Operations in order of creation, each once."""

    def __init__(self) -> None:
        """Without any operation."""
        self.nodes: list[Node] = []
        self._known: dict[Node, int] = {}

    def constant(self, value: float | int) -> int:
        """A number, or a truth value."""
        value = bool(value) if isinstance(value, bool | np.bool_) else float(value)
        return self._kept(Node("const", (type(value).__name__, value)))

    def input(self, position: int) -> int:
        """The ``position``-th input, a number."""
        return self._kept(Node("input", (position,)))

    def value(self, index: int) -> float | bool | None:
        """The value of a constant, None for anything else."""
        node = self.nodes[index]
        return node.arguments[1] if node.operation == "const" else None

    def is_truth(self, index: int) -> bool:
        """Whether a node is a truth value."""
        node = self.nodes[index]
        if node.operation == "select":
            return self.is_truth(node.arguments[1])
        return node.operation in _TRUTHS or isinstance(self.value(index), bool)

    def apply(self, operation: str, *arguments: int) -> int:
        """The node of an operation, simplified."""
        if operation in _COMMUTATIVE:
            arguments = tuple(sorted(arguments))
        values = [self.value(a) for a in arguments]
        if None not in values and operation != "select":
            with np.errstate(all="ignore"):
                return self.constant(_NUMPY[operation](*values))
        simpler = getattr(self, f"_{operation}", None)
        found = simpler(*arguments, *values) if simpler else None
        return self._kept(Node(operation, tuple(arguments))) if found is None else found

    def _kept(self, node):
        if node not in self._known:
            self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return self._known[node]

    def _mul(self, a, b, x, y):
        if 0.0 in (x, y):
            return self.constant(0.0)
        for factor, other in ((x, b), (y, a)):
            if factor in (1.0, -1.0):
                return other if factor == 1.0 else self.apply("neg", other)
        (a, minus_a), (b, minus_b) = self._sign(a), self._sign(b)
        if not (minus_a or minus_b):
            return None
        product = self.apply("mul", a, b)
        return product if minus_a and minus_b else self.apply("neg", product)

    def _add(self, a, b, x, y):
        if 0.0 in (x, y):
            return b if x == 0.0 else a
        for first, (second, minus) in ((a, self._sign(b)), (b, self._sign(a))):
            if minus:
                return self.apply("sub", first, second)
        return None

    def _sub(self, a, b, x, y):
        if 0.0 in (x, y):
            return a if y == 0.0 else self.apply("neg", b)
        second, minus = self._sign(b)
        return self.apply("add", a, second) if minus else None

    def _neg(self, a, x):
        inner, minus = self._sign(a)
        return inner if minus else None

    def _sign(self, index):
        """A node without its sign, and whether it has one."""
        node = self.nodes[index]
        return (node.arguments[0], True) if node.operation == "neg" else (index, False)

    def _div(self, a, b, x, y):
        if y:
            return self.apply("mul", a, self.constant(1.0 / y))
        return None if x == 1.0 else self.apply("mul", a, self.apply("div", self.constant(1.0), b))

    def _and(self, a, b, x, y):
        return b if x is True else a if y is True else self.constant(False) if False in (x, y) else None

    def _select(self, which, when_false, when_true, value, *_):
        if value is not None:
            return when_true if value else when_false
        return when_true if when_true == when_false else None


def traced(graph: Graph, function: Callable, inputs: Any) -> list[np.ndarray]:
    """The nodes of the outputs, in the order of `jax.tree.leaves`.

    Args:
        graph: Holds the operations.
        function: Traceable, without loops of unknown length.
        inputs: Arguments as a tuple of pytrees of integer arrays: the node of each entry.

    Returns:
        An integer array of nodes for each output.

    Raises:
        Scan2FlexError: An operation that has no translation.
    """
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, float), inputs)
    closed = jax.make_jaxpr(function)(*shapes)
    return _evaluate(graph, closed.jaxpr, closed.consts, jax.tree.leaves(inputs))


def _evaluate(graph, jaxpr, constants, arguments):
    known = dict(zip(jaxpr.invars, arguments, strict=True))
    known |= {v: _constants(graph, c) for v, c in zip(jaxpr.constvars, constants, strict=True)}

    def read(x):
        return _constants(graph, x.val) if isinstance(x, Literal) else known[x]

    for equation in jaxpr.eqns:
        found = _equation(graph, equation, [read(x) for x in equation.invars])
        known |= dict(zip(equation.outvars, found, strict=True))
    return [read(x) for x in jaxpr.outvars]


def _constants(graph, values):
    return _entrywise(graph.constant, np.asarray(values))


def _equation(graph, equation, operands):
    """Nodes of the outputs of one equation of a jaxpr."""
    name, parameters = equation.primitive.name, equation.params
    if name in _TRANSLATED:
        return _TRANSLATED[name](graph, parameters, operands)
    if name in _SHAPED:
        return [_SHAPED[name](parameters, *operands)]
    if name in _MOVES:
        return _moved(graph, equation, operands)
    inner = next((parameters[key] for key in _CALLS if key in parameters), None)
    if inner is not None:
        return _evaluate(graph, inner.jaxpr, inner.consts, operands)
    values = [_values(graph, x) for x in operands]
    if None in (None if v is None else 0 for v in values):
        return [_arithmetic(graph, name, parameters, operands)]
    kinds = [x.aval.dtype for x in equation.invars]  # of constants, an index most often
    found = equation.primitive.bind(*map(jnp.asarray, values, kinds), **parameters)
    return [_constants(graph, x) for x in (found if equation.primitive.multiple_results else [found])]


def _branch(graph, parameters, operands):
    """The branch of a `cond` with a known index."""
    index = _values(graph, operands[0])
    if index is None:
        raise _untranslated("cond")
    inner = parameters["branches"][int(index)]
    return _evaluate(graph, inner.jaxpr, inner.consts, operands[1:])


def _untranslated(name):
    return Scan2FlexError(f"the kernel has no translation for the operation {name!r} of JAX: solve without the kernel.")


def _arithmetic(graph, name, parameters, operands):
    name = _ALIASES.get(name, name)
    if name in _NUMPY:
        return _entrywise(lambda *x: graph.apply(name, *x), *operands)
    if name == "select_n":
        return _entrywise(lambda *x: graph.apply("select", *x), *operands)
    if name in _TOTALS:
        return _total(graph, *_TOTALS[name], operands[0], parameters["axes"])
    if name in ("square", "integer_pow"):
        return _entrywise(lambda x: _power(graph, x, parameters.get("y", 2)), *operands)
    if name == "dot_general":
        return _dot(graph, operands[0], operands[1], parameters["dimension_numbers"])
    raise _untranslated(name)


def _entrywise(function, *arrays):
    shape = np.broadcast_shapes(*(a.shape for a in arrays))
    flat = zip(*(np.broadcast_to(a, shape).ravel().tolist() for a in arrays), strict=True)
    return np.array([function(*x) for x in flat], int).reshape(shape)


def _values(graph, nodes):
    """The values of constant nodes, None if one is not constant."""
    values = [graph.value(x) for x in nodes.ravel().tolist()]
    return None if None in values else np.array(values).reshape(nodes.shape)


def _moved(graph, equation, operands):
    """An operation that only moves entries, applied to the numbers of the nodes."""
    name, kept = equation.primitive.name, list(operands)
    first, last = _PLACED.get(name, (len(kept), None))
    for i in range(len(kept))[first:last]:
        kept[i] = _values(graph, kept[i]).astype(int)
    found = equation.primitive.bind(*[jnp.asarray(x) for x in kept], **equation.params)
    return [np.asarray(x) for x in (found if equation.primitive.multiple_results else [found])]


def _broadcast(nodes, shape, dimensions):
    own = dict(zip(dimensions, nodes.shape, strict=True))
    return np.broadcast_to(nodes.reshape([own.get(i, 1) for i in range(len(shape))]), shape)


def _added(graph, parameters, operands):
    """``x.at[indices].add(updates)``, each entry at most once."""
    nodes, indices, updates = operands
    options = {key: parameters[key] for key in ("dimension_numbers", "mode")}
    where = jnp.asarray(_values(graph, indices).astype(int))
    if np.max(jax.lax.scatter_add(jnp.zeros(nodes.shape, int), where, jnp.ones(updates.shape, int), **options)) > 1:
        raise _untranslated("scatter-add")
    nothing = jnp.full(nodes.shape, graph.constant(0.0))
    spread = np.asarray(jax.lax.scatter(nothing, where, jnp.asarray(updates), **options))
    return [_entrywise(lambda *x: graph.apply("add", *x), nodes, spread)]


def _unrolled(graph, parameters, operands):
    inner, constants, carried = parameters["jaxpr"], parameters["num_consts"], parameters["num_carry"]
    fixed, carry, each = operands[:constants], operands[constants : constants + carried], operands[constants + carried :]
    rows = []
    for i in range(parameters["length"])[:: -1 if parameters["reverse"] else 1]:
        found = _evaluate(graph, inner.jaxpr, inner.consts, [*fixed, *carry, *(x[i] for x in each)])
        carry = found[:carried]
        rows.append(found[carried:])
    rows = rows[::-1] if parameters["reverse"] else rows
    return [*carry, *(np.stack(x) for x in zip(*rows, strict=True))]


def _total(graph, operation, neutral, nodes, axes):
    """Sum (or largest, all, any) over some axes."""
    kept = [i for i in range(nodes.ndim) if i not in axes]
    rows = nodes.transpose(*kept, *axes).reshape(*(nodes.shape[i] for i in kept), -1)
    start = np.full(rows.shape[:-1], graph.constant(neutral))
    columns = [rows[..., i] for i in range(rows.shape[-1])]
    return reduce(lambda a, b: _entrywise(lambda *x: graph.apply(operation, *x), a, b), columns or [start])


def _power(graph, x, power):
    if power <= 0:
        one = graph.constant(1.0)
        return graph.apply("div", one, _power(graph, x, -power)) if power else one
    half = _power(graph, x, power // 2) if power > 1 else x
    square = graph.apply("mul", half, half) if power > 1 else x
    return graph.apply("mul", square, x) if power > 1 and power % 2 else square


def _dot(graph, a, b, dimensions):
    """A product of two arrays, as `jax.lax.dot_general` defines it."""
    contracted, batch = dimensions
    (a, left), (b, right) = (_ordered(x, batch[i], contracted[i]) for i, x in enumerate((a, b)))
    product = _entrywise(lambda *x: graph.apply("mul", *x), a[:, :, None], b[:, None])
    shared = left[: len(batch[0])]
    return _total(graph, "add", 0.0, product, (3,)).reshape(*left, *right[len(shared) :])


def _ordered(nodes, batch, contracted):
    """The array as (batch, free, contracted), and the shape of the first two."""
    free = [i for i in range(nodes.ndim) if i not in (*batch, *contracted)]
    nodes = nodes.transpose(*batch, *free, *contracted)
    shape = nodes.shape[: len(batch) + len(free)]
    rows = int(np.prod(shape[: len(batch)]))
    return nodes.reshape(rows, int(np.prod(shape[len(batch) :])), -1), shape


def _converted(graph, parameters, operands):
    """A truth value as a number; everything else is a number already."""
    if not jnp.issubdtype(parameters["new_dtype"], jnp.number):
        return operands
    zero, one = graph.constant(0.0), graph.constant(1.0)
    return [_entrywise(lambda x: graph.apply("select", x, zero, one) if graph.is_truth(x) else x, *operands)]


def _unchanged(graph, parameters, operands):
    return operands


_TRANSLATED: dict[str, Callable] = {
    "scan": _unrolled,
    "cond": _branch,
    "scatter-add": _added,
    "platform_index": lambda graph, p, _: [_constants(graph, p["platforms"].index(None))],  # alternatives of kinds of devices
    "convert_element_type": _converted,
    **dict.fromkeys(("stop_gradient", "copy", "copy_p", "optimization_barrier"), _unchanged),
}
