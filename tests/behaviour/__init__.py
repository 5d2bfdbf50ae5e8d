"""What a user sees: commands, exit codes, files, figures, columns, options and signatures.

It speaks to the suite through its command line and its public imports alone, so it survives a rewrite of the insides.
A difference here is a line in CHANGELOG and a decision, never an accident: ``python -m tests.behaviour`` writes the
lists in ``pinned/`` anew, and ``version-0.2/`` is what version 0.2.0 left on the disk, which nobody makes again.
"""
