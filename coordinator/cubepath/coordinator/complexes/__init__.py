"""State and shape complexes: exploration, links, homology, collapses, surfaces, pictures."""
