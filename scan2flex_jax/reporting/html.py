"""HTML of nested calls: every text is escaped, and only what was made here is taken for markup."""

from collections.abc import Iterable, Sequence
from html import escape

_EMPTY = {"meta", "br", "hr"}


class Html(str):
    """Markup that stands as it is."""

    __slots__ = ()


Part = str | Iterable["Part"]  # texts, markup, or several of them


def joined(*parts: Part) -> Html:
    """Parts one after the other; texts are escaped."""
    out = []
    for part in parts:
        if isinstance(part, str):
            out.append(str(part) if isinstance(part, Html) else escape(part))
        else:
            out.append(str(joined(*part)))
    return Html("".join(out))


def tag(name: str, /, *parts: Part, **attributes: str) -> Html:
    """An element; ``class_`` and ``data_label`` stand for class and data-label."""
    said = "".join(f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items())
    return Html(f"<{name}{said}>" if name in _EMPTY else f"<{name}{said}>{joined(*parts)}</{name}>")


def table(head: Sequence[str], rows: Iterable[Sequence[Part]], numbers: Iterable[int] = ()) -> Html:
    """A table; the columns in ``numbers`` are aligned to the right, and those that no row fills are left out.

    Each cell knows the name of its column, so that a narrow page shows a row as a list.
    """
    rows, right = [tuple(row) for row in rows], set(numbers)
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]

    def cell(kind, k, part, **more):
        return tag(kind, part, **({"class_": "n"} if k in right else {}), **more)

    first = tag("thead", tag("tr", (cell("th", k, head[k]) for k in kept)))
    body = tag("tbody", (tag("tr", (cell("td", k, row[k], data_label=head[k]) for k in kept)) for row in rows))
    return tag("table", first, body)


def section(name: str, title: str, *parts: Part, class_: str = "") -> Html:
    """A section of the page with its heading."""
    return tag("section", tag("h2", title), *parts, id=name, **({"class_": class_} if class_ else {}))
