"""Many captures at once: on the cores of this machine, or on a Dask cluster.

`plan` makes jobs of what was named, `one` does one of them, `run` has Dask do all, `record` and
`page` say what came of it: OUT/batch.json and OUT/index.html.
"""
