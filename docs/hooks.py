"""What the site has beyond the pages of this folder; mkdocs calls these functions by their names (mkdocs.yml, `hooks`).

* Files of the repository as pages: the README is the home page. Links from and to them are turned into links of the site.
* Notebooks, with the outputs that were committed, as pages and pictures. Nothing is executed.
* API pages from the docstrings of the names that packages export (`__all__`), read without importing them.
* Mathematics as MathML, which browsers draw by themselves; the LaTeX is translated when the site is built.
* After the build: no page may load anything from the network.
"""

import ast
import base64
import html
import json
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "scan2flex_jax"
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "scan2flex_jax/examples/README.md": "examples.md",
}
"""Files of the repository that are pages of the site."""

API = {
    "study": ("Study", ("study", "errors")),
    "fitting": ("Fit", ("fitting",)),
    "inference": ("Explain", ("inference", "results", "posterior")),
    "prediction": ("Predict", ("prediction",)),
    "plot": ("Plot", ("plot",)),
    "output": ("Report and export", ("reporting", "export")),
    "rod": ("Rod", ("rod.cable", "rod.boundary", "rod.model", "rod.effect")),
    "statics": ("Equilibrium", ("statics",)),
    "effects": ("Effects", ("effects",)),
    "sweep": ("Sweep", ("sweep",)),
    "convert": ("Convert", ("convert",)),
    "scan": ("Scan", ("scan",)),
    "cache": ("Compiled functions", ("cache",)),
}
"""Page, its title, and the modules whose public names it documents."""

LONG = 60
"""Characters of LaTeX from which a formula in a line may be wider than a telephone: it scrolls by itself."""
_LINK = re.compile(r"(\]\()([^)\s#]+)((?:#[^)\s]*)?\))")
_MATHS = re.compile(r'<(span|div) class="arithmatex">(?:\\\((.*?)\\\)|\\\[(.*?)\\\])</\1>', re.DOTALL)
_LOADED = re.compile(r'<(?:script|img|iframe)\b[^>]*\bsrc="(?:https?:)?//|<link\b[^>]*rel="(?:style|pre)[^>]*"(?:https?:)?//')


def on_files(files: Files, config) -> Files:
    """Add the generated pages and pictures to those of the folder."""
    made = {page: _of_site((ROOT / name).read_text("utf-8"), name, page) for name, page in PAGES.items()}
    made |= _notebooks() | _api()
    for uri, content in made.items():
        files.append(File.generated(config, uri, content=content))
    return files


def on_page_markdown(markdown: str, page, **_) -> str:
    """Links from a page of this folder to files of the repository that are pages themselves."""
    here = posixpath.dirname(page.file.src_uri)

    def link(found):
        target = posixpath.normpath(posixpath.join("docs", here, found[2]))
        page = None if target.startswith("docs/") else _page_of(target)
        return found[0] if page is None else found[1] + posixpath.relpath(page, here or ".") + found[3]

    return _LINK.sub(link, markdown)


def on_page_content(content: str, **_) -> str:
    """Every formula of a page as MathML; tables in a box that scrolls where they are wider than the page."""
    content = _MATHS.sub(_mathml, content)
    return content.replace("<table>", '<div class="wide"><table>').replace("</table>", "</table></div>")


def on_post_build(config) -> None:
    """Refuse a page that loads something from elsewhere, and leave out the page that only servers show."""
    (Path(config.site_dir) / "404.html").unlink(missing_ok=True)
    for page in Path(config.site_dir).rglob("*.html"):
        found = _LOADED.search(page.read_text("utf-8"))
        if found:
            raise PluginError(f"{page.name} loads from the network: {found[0]}")


def _mathml(found: re.Match) -> str:
    latex = html.unescape(found[3] if found[2] is None else found[2]).strip()
    if found[2] is None:
        return convert(latex, display="block")
    formula = convert(latex, display="inline")
    return f'<span class="long">{formula}</span>' if len(latex) > LONG else formula


def _of_site(text: str, name: str, page: str) -> str:
    """Text of a file of the repository, with its links as seen from the ``page`` that it becomes."""

    def link(found):
        if ":" in found[2]:
            return found[0]
        target = posixpath.normpath(posixpath.join(posixpath.dirname(name), found[2]))
        inside = _page_of(target)
        if inside is None:
            raise PluginError(f"{name} links to {found[2]}, which is no page of the site")
        return found[1] + posixpath.relpath(inside, posixpath.dirname(page) or ".") + found[3]

    return _LINK.sub(link, text)


def _page_of(target: str) -> str | None:
    """The page that a file of the repository becomes, if any."""
    if target.startswith("docs/"):
        return target.removeprefix("docs/")
    if target.startswith("notebooks/") and target.endswith(".ipynb"):
        return target.removesuffix(".ipynb") + ".md"
    return PAGES.get(target)


def _notebooks() -> dict[str, str | bytes]:
    """A page for each notebook, its pictures, and the gallery with their titles and first sentences."""
    made: dict[str, str | bytes] = {}
    gallery = ["# Notebooks", "", "Executed notebooks, with the outputs of their last run; tests run them.", ""]
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        name, page = f"notebooks/{path.name}", f"notebooks/{path.stem}.md"
        cells = json.loads(path.read_text("utf-8"))["cells"]
        parts: list[str] = []
        for cell in cells:
            source = "".join(cell["source"]).strip()
            if cell["cell_type"] == "markdown":
                parts.append(_of_site(source, name, page))
            elif source:
                parts.append(f"```python\n{source}\n```")
                parts += _outputs(cell.get("outputs", []), path.stem, made)
        made[page] = "\n\n".join(parts) + "\n"
        title, _, rest = parts[0].partition("\n")
        first = rest.strip().split("\n\n")[0].replace("\n", " ")
        gallery.append(f"* [{title.lstrip('# ')}]({path.stem}.md). {first}")
    return made | {"notebooks/index.md": "\n".join(gallery) + "\n"}


def _outputs(outputs: list[dict], stem: str, made: dict) -> list[str]:
    """What one cell printed and drew, as Markdown; its pictures go to ``made``."""
    parts = []
    for output in outputs:
        data = output.get("data", {})
        if "image/png" in data:
            picture = f"{stem}-{sum(name.startswith(f'notebooks/{stem}-') for name in made) + 1}.png"
            made[f"notebooks/{picture}"] = base64.b64decode("".join(data["image/png"]))
            parts.append(f"![output of the cell above]({picture})")
        elif text := "".join(output.get("text", "") or data.get("text/plain", "")).rstrip():
            parts.append(f"```text\n{text}\n```")
    return parts


def _api() -> dict[str, str]:
    """The API pages: one for each entry of `API`, and the list of the package's own names."""
    made, homes = {}, {}
    for page, (title, modules) in API.items():
        parts = [f"# {title}", ""]
        for module in modules:
            parts += [f"`scan2flex_jax.{module}`: {_head(module)}", ""]
            for name in public_names(module):
                parts += [f"::: scan2flex_jax.{module}.{name}", ""]
                homes[name] = f"{page}.md#scan2flex_jax.{module}.{name}"
        made[f"api/{page}.md"] = "\n".join(parts)
    names = [f"* [`scan2flex_jax.{name}`]({homes[name]})" for name in _exported() if name in homes]
    head = ["# API", "", "Names of `scan2flex_jax` itself; the pages beside this one have those of its packages.", ""]
    return made | {"api/index.md": "\n".join([*head, *names]) + "\n"}


def _source(module: str) -> Path:
    path = PACKAGE.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _head(module: str) -> str:
    """The first sentence of a module's docstring."""
    return (ast.get_docstring(ast.parse(_source(module).read_text("utf-8"))) or "").partition("\n\n")[0].replace("\n", " ")


def public_names(module: str) -> list[str]:
    """The names that a package exports, or the public classes and functions of a plain module."""
    tree = ast.parse(_source(module).read_text("utf-8"))
    if _source(module).name != "__init__.py":
        kinds = (ast.FunctionDef, ast.ClassDef)
        return [node.name for node in tree.body if isinstance(node, kinds) and not node.name.startswith("_")]
    named = [n.asname for node in tree.body if isinstance(node, ast.ImportFrom) for n in node.names if n.asname == n.name]
    listed = [e.value for node in tree.body if _is_all(node) for e in node.value.elts]
    return sorted({*listed, *(n for n in named if n), *()}, key=str.lower)


def _is_all(node: ast.stmt) -> bool:
    """Whether a statement gives ``__all__`` a list, or adds one to it."""
    if not isinstance(node, ast.Assign | ast.AugAssign):
        return False
    target = node.target if isinstance(node, ast.AugAssign) else node.targets[0]
    return isinstance(target, ast.Name) and target.id == "__all__" and isinstance(node.value, ast.List)


def _exported() -> list[str]:
    """The names of the package itself."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text("utf-8"))
    homes = next(n.value for n in tree.body if isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == "_HOMES")
    return [key.value for key in homes.keys]
