"""What is public says of every argument and answer what it is: a type checker knows nothing of what is left unsaid."""

import importlib
import inspect
import pkgutil

import pytest

import scan2flex_jax

PACKAGES = sorted(m.name for m in pkgutil.iter_modules(scan2flex_jax.__path__) if m.ispkg and m.name not in ("cli", "examples"))


def public(package: str):
    """``(name, object)`` of what a package exports."""
    module = importlib.import_module(f"scan2flex_jax.{package}")
    return [(name, getattr(module, name)) for name in getattr(module, "__all__", ())]


def functions(name: str, thing):
    """The functions behind a public name: itself, or a class's own public methods."""
    thing = inspect.unwrap(thing)
    if inspect.isclass(thing):
        own = [(f"{name}.{key}", member) for key, member in vars(thing).items() if not key.startswith("_")]
        return [(key, inspect.unwrap(f)) for key, f in own if inspect.isfunction(f)]
    return [(name, thing)] if inspect.isfunction(thing) else []


def unsaid(function) -> list[str]:
    """Arguments, and the answer, without an annotation."""
    signature = inspect.signature(function)
    empty = inspect.Signature.empty
    found = [p.name for p in signature.parameters.values() if p.annotation is empty and p.name not in ("self", "cls")]
    return found + (["the answer"] if signature.return_annotation is empty else [])


@pytest.mark.parametrize("package", PACKAGES)
def test_public_functions_are_annotated(package):
    found = {
        f"{package}.{name}": lacking
        for public_name, thing in public(package)
        for name, f in functions(public_name, thing)
        if (lacking := unsaid(f))
    }
    assert not found
