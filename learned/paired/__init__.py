"""The paper's network and its variants, trained on a fixed set of pairs that is kept in memory.

What trains, in the order to read it: ``configuration`` (which networks there are), ``network``, ``schedule`` (losses
and plan), ``pairs``, ``gathering``, ``training`` (the objective, for the loop of ``learned.training``), ``fitting``
(from data to a folder with a model) and ``pictures``. What makes forms: ``methods`` (the rows of the tables), ``model``
and ``card``; none of these imports what only trains, but for ``train`` of the methods.
"""
