"""The formal core: sites, actions, what commutes, catalogues, systems and scenes.

It holds the definitions of the paper and what every reader of files needs. It knows no kind of
system, no file format and no message. It imports no other room; every room may import it.
"""
