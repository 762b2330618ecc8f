"""Blind studies with an undeclared effect, made by a rod that shares no code with the package under test.

`rod` solves the continuous Cosserat equations by collocation (`quaternions`, `laws` serve it), `stability` counts the
negative directions of the energy, `scene` and `effects` add physics, `noise` draws measuring errors, `design` draws
cables and poses and `draws` effects, `shapes` compares curves, `rivals` finds which kinds the shapes cannot tell from
the truth, `cases` and `background` put a case together, `studies` writes the files, and `generate` is the command line.
"""
