"""Connected components and two sides, beside networkx."""

import networkx as nx
import numpy as np
from hypothesis import given, strategies as st

from cubepath.coordinator.theory.complexes.surfaces import classes


@given(
    st.integers(1, 12).flatmap(
        lambda count: st.tuples(
            st.just(count),
            st.lists(
                st.tuples(st.integers(0, count - 1), st.integers(0, count - 1), st.booleans()),
                max_size=16,
            ),
        )
    )
)
def test_two_sides_are_a_colouring(drawn: tuple[int, list[tuple[int, int, bool]]]) -> None:
    """A class has two sides iff the graph with an edge put into two for "the same" is bipartite."""
    count, links = drawn
    pairs = np.array([link[:2] for link in links], np.int32).reshape(-1, 2)
    found, two_sided = classes(count, pairs, np.array([link[2] for link in links], np.bool_))
    graph: nx.Graph[int | tuple[str, int]] = nx.Graph()
    graph.add_nodes_from(range(count))
    for place, (one, other, differ) in enumerate(links):
        if differ:
            graph.add_edge(one, other)
        else:
            graph.add_edges_from([(one, ("middle", place)), (("middle", place), other)])
    parts = sorted(
        (sorted(x for x in part if isinstance(x, int)), nx.is_bipartite(graph.subgraph(part)))
        for part in nx.connected_components(graph)
    )
    assert [np.flatnonzero(found == n).tolist() for n in range(len(parts))] == [p[0] for p in parts]
    assert two_sided.tolist() == [part[1] for part in parts]
