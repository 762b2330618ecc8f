"""Unknowns of effects with known starts, for benchmarks that fit what they know."""


def freed(kind: str, values: dict) -> tuple:
    """The parameters of an effect that can be estimated as unknowns that start at these ``values``."""
    from scan2flex_jax.study import Unknown  # noqa: PLC0415 - the environment must be set first
    from scan2flex_jax.study.kinds import kind_format  # noqa: PLC0415

    estimable = {p.name for p in kind_format(kind).parameters if p.estimable}
    return tuple(Unknown(f"{kind}.{name}", guess=value) for name, value in values.items() if name in estimable)
