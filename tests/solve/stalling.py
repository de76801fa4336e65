"""A solver that stalls, for those who call one."""

from contextlib import contextmanager

import pytest

from rakelight import solve as solving


@contextmanager
def stalling_solver(after=0):
    """Within it, every solve but the first `after` ends where it starts; gives the list of them."""
    iterate, solved = solving.iterate, []

    def run(system, start, *rest):
        solved.append(len(solved) < after)
        return iterate(system, start, *rest) if solved[-1] else (start.copy(), 0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solving, "iterate", run)
        yield solved
