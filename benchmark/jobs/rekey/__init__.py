"""Records of older code get the keys of this code, where a sample of the work comes out the same under both.

In the order to read it: ``sampling`` (the stages of a few shapes, made by one of the two trees), ``reached`` (which
parts of the code ran meanwhile), ``trees`` (a commit beside the working tree, and requests answered by either),
``syntax`` and ``changes`` (which parts of the code differ), ``candidates`` (which rows may move), ``moving`` (records
under new keys).
"""
