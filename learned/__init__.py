"""The networks that learn canonical forms.

``paired`` is the paper's, trained on pairs; ``streamed`` learns from bodies that are never seen twice; ``field`` does
so from complete surfaces; ``training`` is what all trainings share. Here is what all networks share: ``learner`` (a
model, and what is asked of it), ``described`` (named configurations), ``images`` and ``surface`` (between images and
networks), ``frame`` (of a complete surface) and ``weights`` (on disk).
"""
