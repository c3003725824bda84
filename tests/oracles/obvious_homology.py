"""The obvious homology of a small complex: dense boundary matrices, Smith forms, ranks modulo 2.

Shares nothing with the fast way but the format of the complex and python-flint.
"""

from flint import fmpz_mat, nmod_mat

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex

Groups = tuple[tuple[int, ...], tuple[tuple[int, ...], ...], tuple[int, ...]]


def boundary(complex_: CubicalComplex, k: int) -> fmpz_mat:
    """Return the boundary from dimension k: a row for each (k-1)-cube, a column for each k-cube."""
    counts = complex_.f_vector
    rows = counts[k - 1] if k else 0
    columns = counts[k] if k < len(counts) else 0
    matrix = fmpz_mat(rows, columns)
    if rows:
        for cube in range(columns):
            for j in range(k):
                for e in (0, 1):
                    face = int(complex_.faces[k][cube, j, e])
                    matrix[face, cube] += (-1) ** j * (1 if e else -1)
    return matrix


def obvious_homology(complex_: CubicalComplex) -> Groups:
    """Return Betti numbers, invariant factors greater than 1, and Betti numbers modulo 2."""
    matrices = [boundary(complex_, k) for k in range(len(complex_.faces) + 1)]
    betti, torsion, betti_z2 = [], [], []
    for k, count in enumerate(complex_.f_vector):
        here, above = matrices[k], matrices[k + 1]
        betti.append(count - here.rank() - above.rank())
        betti_z2.append(count - nmod_mat(here, 2).rank() - nmod_mat(above, 2).rank())
        form = above.snf()
        diagonal = [abs(int(form[i, i])) for i in range(min(form.nrows(), form.ncols()))]
        torsion.append(tuple(factor for factor in diagonal if factor > 1))
    return tuple(betti), tuple(torsion), tuple(betti_z2)
