"""A solver that stalls, for those who call one."""

from contextlib import contextmanager

import pytest

from rakelight.solve import Multigrid


@contextmanager
def stalling_solver(after=0):
    """Within it, every solve but the first `after` ends where it starts; gives the list of them."""
    solve, solved = Multigrid.run, []

    def run(self, system, start, *rest):
        solved.append(len(solved) < after)
        return solve(self, system, start, *rest) if solved[-1] else (start.copy(), 0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Multigrid, "run", run)
        yield solved
