"""Geometry without physics: rotations, rigid motions and framed curves."""
