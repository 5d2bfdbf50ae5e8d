"""The networks that learn canonical forms.

``paired`` is the paper's, trained on pairs; ``streamed`` learns from bodies that are never seen twice. Here is what
they share: ``learner`` (a depth image in, a surface out), ``images`` and ``surface`` (between images and networks),
``weights``, ``saving`` and ``checkpoint`` (on disk), ``machine``, ``arithmetic`` and ``measures``.
"""
