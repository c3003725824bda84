"""Runs from launch to recording: gathering, schedules, contents of a recording, pictures.

It imports `normal_form`, `verification` for certificates, and `processes`, `rules` and `rendering`
of the agents. It is the only room of the coordinator that starts modules and listens to them.
`shortening` takes the path of a recording from it.
"""
