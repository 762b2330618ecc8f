"""Options of the commands that read frames and curves of other tools, with their checks."""

import math
from typing import Annotated

import typer

from scan2flex_jax.cli.options import choices
from scan2flex_jax.errors import Scan2FlexError


def _known(check: str):
    """A callback that refuses a name which the function ``check`` of `scan2flex_jax.convert` does not know."""

    def callback(name: str | None) -> str | None:
        if name is not None:
            from scan2flex_jax import convert  # noqa: PLC0415

            getattr(convert, check)(name)
        return name

    return callback


_UNITS = ("m", "dm", "cm", "mm", "um", "in", "ft")
_ANGLES = ("kuka", "fanuc", "staubli", "kawasaki", "rpy", "rotvec", "ZYX", "XYZ", "xyz", "zyx")
_QUATERNIONS = ("scalar-first", "scalar-last")
Units = Annotated[
    str | None,
    typer.Option(
        help=f"Unit of lengths in the files: {', '.join(_UNITS)}.",
        autocompletion=choices(*_UNITS),
        callback=_known("length_unit"),
    ),
]
Columns = Annotated[str | None, typer.Option(help="Columns of a curve, as in s,x,y,z, -,x,y,z or, in a plane, x,z.")]
Convention = Annotated[
    str | None,
    typer.Option(
        help="Convention of three angles: kuka, fanuc, staubli, kawasaki, rpy, rotvec, or axes (ZYX moving, xyz fixed);"
        " of quaternions q1 to q4: scalar-first or scalar-last.",
        autocompletion=choices(*_ANGLES, *_QUATERNIONS),
        callback=_known("check_convention"),
    ),
]
Radians = Annotated[bool, typer.Option("--radians", help="Angles are in radians, not in degrees.")]
Tangent = Annotated[
    str,
    typer.Option(
        help="Axis of the given frames along the cable, from start to end: x, y, z, -x, -y, -z.",
        autocompletion=choices("x", "y", "z", "-x", "-y", "-z"),
        callback=_known("axes_of"),
    ),
]


def numbers(text, count, what):
    """``count`` finite numbers of an option; raises `Scan2FlexError`."""
    try:
        values = [float(cell) for cell in text.replace(",", " ").split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise Scan2FlexError(f"the {what} {text[:60]!r} is not {count} numbers: separate them by commas or blanks.")
    return values
