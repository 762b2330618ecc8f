"""The hypotheses of a search as numbers, from which a later process continues without a second search.

A record holds each hypothesis at its mode (components with their sites, parameters, sizes of noise and discrepancy), and the
scores to first order. It is for the same study, mesh, settings and program; a score that is not reproduced voids it.
"""

from typing import Any

import numpy as np

from scan2flex_jax.effects.catalogue import catalogue, fields, laws
from scan2flex_jax.posterior.posterior import Fitted, Variant
from scan2flex_jax.posterior.program import Component
from scan2flex_jax.posterior.search import Scored, Search

Record = dict[str, Any]

_SAME = 0.05  # nats: largest difference of a score from that of the record, far below what decides


def recorded(search: Search) -> Record:
    """The record of a search in the first of its variants; JSON keeps its numbers exactly."""
    first = search.variants[0]
    scores = {kind: {"gain": float(s.gain), **_plain(s.component), "amplitudes": s.amplitudes.tolist()}
              for kind, s in search.scores.items()}  # fmt: skip
    return {
        "elements": first.program.elements,
        "hypotheses": [_of(h) for h in search.ranked if h.variant is first and h.components],
        "scores": scores,
    }


def _of(h: Fitted) -> Record:
    rest = {"x": h.x.tolist(), "u": h.u.tolist(), "converged": bool(h.converged), "score": float(h.score)}
    return {"components": [_plain(c) for c in h.components]} | rest


def _plain(component: Component) -> Record:
    """A component with the entries of its site as JSON has them; a list is a tuple, an array is marked as one."""
    site: Record = {}
    for name, value in component.site.items():
        plain = np.asarray(value).tolist()
        site[name] = {"array": plain} if isinstance(plain, list) and not isinstance(value, tuple) else plain
    return {"kind": component.kind, "site": site}


def replayed(record: Record, variant: Variant, say) -> Search | None:
    """The search that was recorded; None for a record of another study, mesh or program."""
    search = Search([variant], say)
    try:
        if record["elements"] != variant.program.elements:
            return None
        for one in record["hypotheses"]:
            components = tuple(map(_component, one["components"]))
            h = variant.at(components, np.array(one["x"], float), np.array(one["u"], float), one["converged"])
            if h is None or not abs(h.score - one["score"]) < _SAME:
                return None
            search.add(h)
        for kind, s in record["scores"].items():
            search.scores[kind] = Scored(float(s["gain"]), _component(s), np.array(s["amplitudes"], float))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):  # a record of another form
        return None
    return search


def _component(plain: Record) -> Component:
    known = {e.kind for e in (*catalogue(), *fields(), *laws())}
    if plain["kind"] not in known:
        raise ValueError(plain["kind"])
    site: Record = {}
    for name, value in plain["site"].items():
        site[name] = np.array(value["array"]) if isinstance(value, dict) else tuple(value) if isinstance(value, list) else value
    return Component(plain["kind"], site)
