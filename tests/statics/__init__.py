"""Tests of the equilibrium and its derivatives against closed forms and independent solutions."""
