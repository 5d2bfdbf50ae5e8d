"""Protocols of the experiments as data: galleries, tables, trainings and their models."""
