"""Which photographs do not fit the others: blurred, moved, turned, taken under another lamp too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.errors import listed
from rakelight.model import Finding, Floats, Mask, photograph_names

# Ratio of a photograph's prediction error to the median one's, above which it is suspect; both in
# light and relative to its own brightness, since a dark photograph's noise is large relative to its
# brightness, and a bright one's model errors are large in light.
ODD = 2.5
# Error over the photograph's own variation on the object, above which it shows something else, if
# that is `ODD` times the median one's, too.
UNEXPLAINED = 0.5
# Least number of photographs: with fewer each prediction depends on a few others.
FEWEST = 6
# Largest fraction of odd photographs: with more the median one may be wrong.
MOST = 0.34


@dataclass(frozen=True)
class Oddity:
    """Which photographs may not fit the others.

    suspect : (N,) those that are predicted badly; leaving them out has to help the others
    foreign : (N,) those that show something else, for sure
    """

    suspect: Mask
    foreign: Mask

    @property
    def either(self) -> Mask:
        """(N,) suspect or foreign."""
        return self.suspect | self.foreign

    @property
    def least_help(self) -> float:
        """Others' errors without the suspects, over those with them, have to be below this.

        Of N photographs, one with `ODD` times the others' error has about `ODD / N` of the weight.
        """
        return 1 - ODD * np.count_nonzero(self.either) / len(self.suspect)


def odd_photographs(errors: Floats, brightness: Floats, variation: Floats) -> Oddity:
    """Which photographs do not fit the others.

    errors : (N,) typical error of each as the others predict it
    brightness, variation : (N,) mean of each, and typical deviation of its pixels from its median

    >>> errors, ones = np.array([1.0, 1.2, 0.9, 1.1, 1.0, 6.0]), np.ones(6)
    >>> odd_photographs(errors, 20 * ones, 10 * ones).suspect.tolist()
    [False, False, False, False, False, True]
    """
    none = np.zeros(len(errors), dtype=bool)
    if len(errors) < FEWEST or not np.isfinite(errors).any():
        return Oddity(none, none)
    relative, unexplained = (
        errors / np.maximum(whole, np.finfo(float).tiny) for whole in (brightness, variation)
    )
    light, share, part = (
        np.nan_to_num(each / max(float(np.nanmedian(each)), np.finfo(float).tiny)) > ODD
        for each in (errors, relative, unexplained)
    )
    found = Oddity(light & share, part & (np.nan_to_num(unexplained) > UNEXPLAINED))
    return found if found.either.sum() <= MOST * len(errors) else Oddity(none, none)


def odd_finding(names: tuple[str, ...], odd: Mask, kept: bool = False) -> Finding:
    """The warning about photographs that do not fit the others.

    names : of all; odd : (N,) which; kept : whether they were used, not left out
    """
    named = photograph_names(names, len(odd))
    return Finding(
        "warning",
        "odd-photographs",
        (
            "used, as the method takes no fewer, but not explained by the others: "
            if kept
            else "left out, as the others do not explain them: "
        )
        + listed(named, odd),
        "take these again: sharp, with the camera and the object still, under the one lamp alone",
    )
