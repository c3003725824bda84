"""What goes over zenoh: messages, keys, session settings, nodes and the shells that carry them.

The bytes of a message are the same on the wire and in the recording. It imports `core`, and
`path_files` for the certificate that a recording carries. Modules send these messages, recordings
hold them, and runs and verification read them; code about states and paths alone does not use them.
"""
