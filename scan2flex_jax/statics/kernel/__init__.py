"""The default solver compiled for the processor: optional, several times as fast, with the same result to rounding.

`python -m scan2flex_jax.statics.kernel` translates the arithmetic of an element from the package's own functions (`elements`,
`symbolic`) to C++, compiles it with the steps of the solver (`solver.h`), checks it and keeps it in the user's cache folder
(`library`). From then on it solves every rod (`solver`) on one CPU whose effects add no energy of their own. All others, and
installations without it, use `statics.newton`. Where JAX has a GPU, the same arithmetic is compiled for it without a
command (`settle.cu`, `cuda`, `foreign`).
"""
