"""The paper's network and its variants, trained on a fixed set of pairs that is kept in memory.

What trains, in the order to read it: ``configuration`` (which networks there are), ``network``, ``schedule`` (losses),
``pairs``, ``gathering``, ``training`` (the loop), ``fitting`` (from data to a folder with a model), ``saving`` and
``pictures``. What makes forms: ``methods`` (the rows of the tables), ``prediction``, ``model`` and ``card``; none of
these imports what only trains, but for ``train`` of the methods.
"""
