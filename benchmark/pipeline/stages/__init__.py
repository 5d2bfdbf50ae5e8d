"""Stages of the pipeline, one module each: pure functions from arrays to arrays.

The imports of a module define the code of its stage, so no module here imports the store or the plan.
"""
