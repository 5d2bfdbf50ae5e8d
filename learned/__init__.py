"""The networks that learn canonical forms.

``paired`` is the paper's, trained on pairs; ``streamed`` learns from bodies that are never seen twice; ``field`` does
so from complete surfaces; ``template`` deforms such surfaces into one. Here is what they share: ``learner`` (a model,
and what is asked of it), ``images`` and ``surface`` (between images and networks), ``frame`` (of a complete surface),
``weights``, ``saving`` and ``checkpoint`` (on disk), ``machine``, ``arithmetic`` and ``measures``; what trainings over
a stream share: ``described`` (named configurations), ``stream`` (batches made ahead), ``steps`` (the loop) and
``fitting`` (to a folder with a model).
"""
