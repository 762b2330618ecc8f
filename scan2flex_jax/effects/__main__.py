"""``python -m scan2flex_jax.effects`` writes the formats of all effects to a table that `study.kinds` reads without JAX."""

import dataclasses
import json

from scan2flex_jax.effects.catalogue import EFFECTS
from scan2flex_jax.effects.format import format_of
from scan2flex_jax.study.kinds import TABLE, KindFormat, ParameterFormat


def table() -> str:
    """The text of the table: one line for each effect, in the order of the list."""
    formats = [form for form in (format_of(entry.effect) for entry in EFFECTS) if form is not None]
    return "{\n" + ",\n".join(f"{json.dumps(form.kind)}: {json.dumps(_said(form))}" for form in formats) + "\n}\n"


def _said(form: KindFormat) -> dict:
    memory = {} if form.memory == "none" else {"memory": form.memory}
    return {"place": form.place, "words": form.words, **memory, "parameters": {p.name: _differing(p) for p in form.parameters}}


def _differing(parameter: ParameterFormat) -> dict:
    """The unit, and every field that differs from the default of `ParameterFormat`."""
    fields = dataclasses.fields(parameter)[1:]
    return {f.name: getattr(parameter, f.name) for f in fields if getattr(parameter, f.name) != f.default}


if __name__ == "__main__":
    TABLE.write_text(table(), "utf-8")
