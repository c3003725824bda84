"""A run as a page: what a browser shows of it, as data, and the page around that.

It takes scenes and steps, and recordings for claims and messages; it imports
`normal_form`, and `rendering` of the agents. The page itself is plain HTML, CSS and JavaScript in
`page/`, which `pages` puts into one file.
"""
