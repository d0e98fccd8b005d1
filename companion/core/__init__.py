"""The equations and their one order.

What may stand in a file here (tests/unit/test_compiled.py holds it):

- imports of `math`, `typing`, `collections.abc`, `companion.core` and `companion.records`, and no others;
- NamedTuples of floats, ints, bools, tuples and lists of floats, made by keyword and changed by `_replace`;
- functions of these, without a class, a clock, a file or NumPy; `four.each` for what is done to each of four.

The live loop runs these functions as they stand, and the lab compiles them with numba (`lab.batch.compiled`).
"""
