"""Rotations, rigid motions and framed curves: the geometry that knows no physics."""
