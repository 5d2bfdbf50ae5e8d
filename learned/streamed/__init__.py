"""Networks that are trained on an endless stream of fresh bodies; no body is seen twice.

Modules in reading order: ``configuration`` (named networks), ``images`` (a batch of fresh bodies), ``network``,
``losses``, ``training``, ``fitting`` (to a folder with a model), ``model`` (from files to forms; joins front and back
to a closed surface), ``methods``.
"""
