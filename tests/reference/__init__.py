"""Reference solutions that share no code with the package: numpy and scipy only.

Each module derives its figures anew from the differential equations or a closed form; the tests of the package
compare with these, and `test_reference_values.py` compares these with certified figures.
"""
