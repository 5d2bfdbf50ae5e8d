"""Training loop, checkpoints and cards of all networks.

In the order to read it: ``fitting`` (from data to a folder with a model), ``loop`` (plan, objective, steps), ``stream``
(batches made ahead), ``checkpoint``, ``average``, ``machine`` and ``measures``.
"""
