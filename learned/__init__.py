"""The depth network that learns canonical forms.

Read in this order: ``configuration`` (which networks there are), ``network``, ``schedule`` (losses), ``training`` (the
loop), ``fitting`` (from data to a folder with a model), ``prediction`` and ``methods`` (the rows of the tables).
"""
