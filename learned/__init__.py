"""Networks that learn canonical forms.

Subpackages: ``paired`` (the paper's network, trained on pairs), ``streamed`` (trained on images of bodies that are
never seen twice), ``field`` (trained on complete surfaces) and ``training`` (shared by all trainings). Modules:
``learner`` (base classes), ``described`` (named configurations), ``images`` (resampling, and surfaces behind images),
``frame`` (of a complete surface) and ``weights`` (on disk).
"""
