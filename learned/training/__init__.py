"""Training loop, checkpoints and cards of all networks.

Modules in reading order: ``fitting`` (from data to a folder with a model), ``loop`` (plan, objective, steps),
``stream`` (batches made ahead), ``checkpoint`` and ``machine``.
"""
