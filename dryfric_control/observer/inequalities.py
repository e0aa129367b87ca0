"""Linear matrix inequalities over many blocks, solved through cvxpy.

Each block is one affine matrix of a few entries of one vector of unknowns:
cvxpy then has little to analyse, and the same builder serves every memory of
the observer, from two nodes to hundreds.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from dryfric_control.arrays import Floats

SOLVERS = ("clarabel", "scs")


@dataclass
class MatrixProgram:
    """Minimise one variable subject to matrix inequalities ``B + margin I <= 0``."""

    size: int  # number of variables
    margin: float
    _blocks: list[tuple[NDArray[np.intp], Floats, Floats]] = field(default_factory=list)

    def below_zero(self, index: NDArray[np.intp], columns: Floats, constant: Floats) -> None:
        """Demand ``constant + sum_k x[index[k]] columns[k] <= 0``."""
        self._blocks.append((index, columns, constant))

    def minimise(self, objective: int | None, solver: str) -> tuple[Floats, str]:
        """Solve for the smallest value of variable `objective`."""
        import cvxpy as cp

        x = cp.Variable(self.size)
        constraints = []
        for index, columns, constant in self._blocks:
            n = constant.shape[0]
            entries = sp.csr_array(columns.reshape(len(index), n * n).T)
            matrix = cp.reshape(entries @ x[index] + constant.ravel(), (n, n), order="C")
            constraints.append(matrix << -self.margin * np.eye(n))
        problem = cp.Problem(cp.Minimize(0 if objective is None else x[objective]), constraints)
        # SCS is a first-order method: at its own tolerances its answer fails the certificate.
        options: dict[str, Any] = {"solver": cp.CLARABEL}
        if solver == "scs":
            options = {"solver": cp.SCS, "eps_abs": 1e-7, "eps_rel": 1e-7, "max_iters": 200_000}
        with warnings.catch_warnings():
            # "The solution may be inaccurate": the certificate decides that here.
            warnings.simplefilter("ignore", UserWarning)
            try:
                problem.solve(**options)
            except cp.SolverError as problem_found:
                return np.full(self.size, np.nan), str(problem_found)
        values = np.full(self.size, np.nan) if x.value is None else np.asarray(x.value)
        return values, str(problem.status)
