"""The time budget of a diagnosis."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from mpge_bench.diagnosis.settings import ChooseSettings
from mpge_bench.envs.compiled import begin_budget, is_past


@dataclass(frozen=True)
class Clock:
    """When the search began, when it is to begin nothing new, and when all is to be said, s of the monotonic clock."""

    begun: float
    deadline: float
    end: float = math.inf

    @classmethod
    def started(cls, seconds: float | None, settings: ChooseSettings) -> Clock:
        """Now, with a time budget of `seconds`, None for as long as it takes; what the settings reserve of it is left for what comes after the search."""
        begun = begin_budget()
        if seconds is None:
            return cls(begun, math.inf)
        reserve = max(settings.reserved * seconds, min(settings.reserved_least, settings.reserved_most * seconds))
        return cls(begun, begun + seconds - reserve, begun + seconds)

    @property
    def late(self) -> bool:
        return is_past(self.deadline)

    def lacks(self, seconds: float) -> bool:
        """Whether what takes so long would end after the deadline."""
        return is_past(self.deadline - seconds)

    def within(self, share: float) -> Clock:
        """One that is late when a `share` of the time that is left until the deadline has passed."""
        now = time.monotonic()
        return replace(self, deadline=now + share * (self.deadline - now))

    def later(self, share: float) -> Clock:
        """One that is late when a `share` of what is left for the verdict has passed, too."""
        return self if math.isinf(self.end) else replace(self, deadline=self.deadline + share * (self.end - self.deadline))

    def sooner(self, share: float) -> Clock:
        """One that is late when only a `share` of the time until the deadline is left."""
        return replace(self, deadline=self.begun + (1 - share) * (self.deadline - self.begun))
