"""A run as a page: its data for a browser, and the page around it.

It takes scenes and steps, and recordings for claims and messages. It imports `normal_form`, and
`rendering` of the agents. The page itself is plain HTML, CSS and JavaScript in `page/`, which
`pages` joins into one file.
"""
