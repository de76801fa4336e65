"""What comes out of a solve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rakelight.errors import InputError
from rakelight.model import Floats

Status = Literal["converged", "stalled", "iteration limit"]


@dataclass(frozen=True, slots=True)
class Solution:
    """What a solver found.

    value : (H, W) float64, the target outside the mask
    status : "converged" to the tolerance asked for; "iteration limit"; or "stalled" short of
        it: rounding left nothing to gain, or the matrix is not positive definite.  `value` is
        the last iterate in every case, and its energy is never above the start's.
    relative_residual : |rhs - A value| over |rhs|, or over |rhs - A origin| where a change from
        there was sought; over the unknowns, computed anew at the end
    """

    value: Floats
    status: Status
    iterations: int
    relative_residual: float
    seconds: float

    @property
    def converged(self) -> bool:
        """Whether `value` meets the tolerance that was asked for."""
        return self.status == "converged"

    def required(self, source: str) -> Floats:
        """`value`, for a caller that has no use for one that misses the tolerance.

        source : what was to be solved for

        Raises InputError unless it converged.
        """
        if self.converged:
            return self.value
        raise InputError(
            "its linear system could not be solved",
            source=source,
            seen=f"{self.status}, relative residual {self.relative_residual:.1e}",
        )
