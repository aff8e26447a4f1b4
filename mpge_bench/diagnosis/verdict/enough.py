"""How much more would have to be recorded before the test for a mismatch could tell."""

from __future__ import annotations

import math

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.verdict.result import MoreData


def more_data(choice: Choice) -> MoreData:
    """Windows, and seconds of recording, with which the same mismatch would be significant.

    Evidence grows with the number of windows, so that the logarithm of p is about in proportion to it; of a few windows no p by signs is small enough.
    """
    problem, test = choice.problem, choice.test
    settings, windows = problem.settings, len(problem.windows.start)
    fewest = 2 + math.floor(math.log2(1 / settings.choose.significance))
    wanted = windows * math.log(settings.choose.significance) / math.log(min(test.p_value, settings.verdict.no_evidence))
    needed = max(fewest, math.ceil(wanted), windows + 1)
    # Of what is recorded more a part is held out, too.
    recorded = sum(one.duration for one in problem.recordings) / (1 - settings.data.unseen)
    return MoreData(windows, needed, recorded * (needed / windows - 1))
