"""State and shape complexes: exploration, links, homology, collapses, surfaces, pictures.

It takes a scene, or any cubical complex as arrays of faces; it knows no path, no message and no
recording. It imports the protocol, `agents.rendering` for pictures, and nothing from the
coordinator. Searches and the paper's claims are built on it.
"""
