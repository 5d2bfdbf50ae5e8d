"""The depth network that learns canonical forms.

What trains, in the order to read it: ``configuration`` (which networks there are), ``network``, ``schedule`` (losses),
``pairs``, ``training`` (the loop), ``checkpoint``, ``fitting`` (from
data to a folder with a model), ``saving`` and ``pictures``. What makes forms: ``methods`` (the rows of the tables),
``prediction``, ``model`` and ``images``; none of these imports what only trains, but for ``train`` of the methods.
"""
