"""The paper's network and its variants, trained on a fixed set of pairs that is kept in memory.

Modules for training, in reading order: ``configuration`` (named networks), ``network``, ``schedule`` (losses and plan),
``pairs``, ``gathering``, ``training`` (the objective, for the loop of ``learned.training``), ``fitting`` (from data to
a folder with a model) and ``pictures``. Modules for forms: ``methods`` (the rows of the tables), ``model`` and
``card``; these import no module that is only for training, except in ``train`` and ``check_options`` of the methods.
"""
