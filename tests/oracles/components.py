"""Where one never comes away from in a graph: for explorations in tests."""

from collections.abc import Sequence


def bottoms(  # noqa: C901 - one loop, so that no recursion is too deep
    following: Sequence[Sequence[int]],
) -> list[list[int]]:
    """Return the strongly connected components that nothing leads out of (Tarjan, iteratively)."""
    index = [-1] * len(following)
    low = [0] * len(following)
    on_stack = bytearray(len(following))
    component = [-1] * len(following)
    stack: list[int] = []
    components: list[list[int]] = []
    count = 0
    for root in range(len(following)):
        if index[root] >= 0:
            continue
        work = [(root, 0)]
        while work:
            node, at = work.pop()
            if at == 0:
                index[node] = low[node] = count
                count += 1
                stack.append(node)
                on_stack[node] = 1
            after = following[node]
            while at < len(after):
                other = after[at]
                at += 1
                if index[other] < 0:
                    work.append((node, at))
                    work.append((other, 0))
                    break
                if on_stack[other]:
                    low[node] = min(low[node], index[other])
            else:
                if low[node] == index[node]:
                    found = []
                    while True:
                        other = stack.pop()
                        on_stack[other] = 0
                        component[other] = len(components)
                        found.append(other)
                        if other == node:
                            break
                    components.append(found)
                if work:
                    parent = work[-1][0]
                    low[parent] = min(low[parent], low[node])
    return [
        each
        for number, each in enumerate(components)
        if all(component[other] == number for node in each for other in following[node])
    ]
