"""One plan on several machines: cut into shards for queue systems, or as jobs to the workers of a dask cluster."""
