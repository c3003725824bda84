"""The formal core: sites, actions, what commutes, catalogues, systems and scenes."""
