"""Compiled parts: numbers and arrays in, numbers and arrays out.

This room lies at the bottom of the house beside `mathematics`. It imports numpy, math and numba,
and nothing of the package.

* `compiling`: how kernels are compiled, and kept on the disk;
* `parts`: functions that numba chooses by the class of a named tuple.
"""
