"""Plans of other planners, read as moves of the systems here.

There is one module per format; `read_plan` detects the format. It imports `path_files`, `scenes`,
`systems` and `core`. Only shortening takes such plans.
"""
