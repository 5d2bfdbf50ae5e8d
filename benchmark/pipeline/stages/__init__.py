"""The stages of the pipeline, one module each: pure functions from arrays to arrays.

What a module imports, and nothing else, is the code of its stage; so no module here knows the store or the plan.
"""
