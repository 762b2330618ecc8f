"""The version of the package, without dependencies on its other parts."""

__version__ = "0.1.0"
