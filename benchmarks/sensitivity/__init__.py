"""The paper's Section 6.2 in full, and beyond: what guesses, turned clamps and natural curvature do to the estimates.

`python -m benchmarks.sensitivity [PART ...]` from the repository's root writes `benchmarks/results/sensitivity.json` and
pictures to `docs/sensitivity`. The cable is the one of `benchmarks.paper`. Each part is a module:

    guesses      recovery over 5 x 5 and 33 x 33 guesses, by four methods
    clamps       clamp orientations turned at random: the error, where it comes from, and what a prior on them does
    curvature    natural curvature beside both stiffnesses: along one axis, any axis, local, varying along the cable
    cantilever   relative error of EI over EI/(g rhoA), beside the formula (the paper's Section 2.4)
    batches      lanes in a loop and in `jax.vmap`
    minima       33 x 33 guesses as one batched program, beside the loop

`bench` keeps every sweep on disk (`build/sensitivity`): a run that is killed, or whose time is up, goes on from there.
"""
