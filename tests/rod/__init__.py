"""Tests of the rod's energy and of the derivatives assembled from it."""
