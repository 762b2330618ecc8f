"""Tests of rotations, rigid motions and curves."""
