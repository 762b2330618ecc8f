"""Static equilibrium: starts, solvers, the answer with its verdict, and its derivatives."""
