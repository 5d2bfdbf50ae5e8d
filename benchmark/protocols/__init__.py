"""Protocols of the experiments, as data: tables, trainings, and the models that belong to them."""
