"""The stages of the pipeline, one module each: pure functions from arrays to arrays.

The code of a stage is what its module imports, so no module here imports the store or the plan.
"""
