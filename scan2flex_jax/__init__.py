"""Stiffness of a cable from its shapes."""
