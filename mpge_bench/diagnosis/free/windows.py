"""Short windows of recordings, predicted by the simulator from starts that are fitted: as far from what was recorded as its noise makes likely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.free.motion import Motion, Noise
from mpge_bench.diagnosis.free.simulator import Simulator
from mpge_bench.diagnosis.settings import FreeSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import Layout

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
#: What windows have one of each, but for their past.
_EACH = ("recording", "first", "u", "start", "spread", "measured", "shift", "slopes", "offset")


@dataclass(frozen=True)
class Windows:
    """n windows of so many rows each, all of the same length.

    Attributes:
        simulator: that predicts them.
        recording: which of the recordings each is of, shape (n,).
        first: the row of its start, shape (n,).
        u: commands from the start on, shape (n, rows, joints).
        past: commands and states of the rows before.
        start: state as it was recorded or smoothed, shape (n, nq + nv).
        spread: how far that may be off, one standard deviation, shape (n, 2 nv).
        measured: coordinates at the rows after the start, shape (n, rows, nq).
        noise: of coordinates, along the tangent, shape (nv,).
        shift: change of the start about which the simulator is linearised, shape (n, 2 nv).
        slopes: derivatives of what it misses by that change, in standard deviations of `noise`, shape (n, rows · nv, 2 nv).
        settings: of the whole.
        offset: what `simulator` misses too little by its long steps, shape (n, rows · nv); 0 where it has none.
    """

    simulator: Simulator
    recording: Rows
    first: Rows
    u: Array
    past: tuple[tuple[Array, Array], ...]
    start: Array
    spread: Array
    measured: Array
    noise: Array
    shift: Array
    slopes: Array
    settings: FreeSettings
    offset: Array

    def __len__(self) -> int:
        return len(self.start)

    @property
    def layout(self) -> Layout:
        """Of its states."""
        return self.simulator.rig.layout

    def part(self, chosen: npt.NDArray[np.bool_] | Rows) -> Windows:
        """Some of the windows."""
        index = np.arange(len(self))[chosen]
        return replace(self, past=tuple(self.past[one] for one in index), **{name: getattr(self, name)[index] for name in _EACH})

    @staticmethod
    def joined(parts: Sequence[Windows]) -> Windows:
        """`parts` of the same windows, one after the other."""
        if len(parts) == 1:
            return parts[0]
        each: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _EACH}
        return replace(parts[0], past=tuple(one for part in parts for one in part.past), **each)

    def heads(self, total: int) -> Rows:
        """About `total` windows, evenly spread; all if there are no more."""
        return np.unique(np.linspace(0, len(self) - 1, min(total, len(self))).round().astype(np.int64))

    def stretches(self, total: int, length: int) -> Rows:
        """As `heads`: every window has its own start."""
        return self.heads(total)

    def blocks(self, length: int) -> list[Rows]:
        """Each by itself."""
        return list(np.arange(len(self))[:, None])

    @property
    def entries(self) -> int:
        """Coordinates at all rows, and those of the start."""
        return int(self.slopes.shape[1] + self.slopes.shape[2])

    @property
    def sets(self) -> int:
        """All are one draw."""
        return 1

    def coarser(self) -> Windows:
        """The same, predicted with longer steps where the simulator is slow, for what effects change: by motors, which are asked at each step."""
        coarse = self.simulator.coarser(self.settings.coarse) if self.simulator.rig.joints else self.simulator
        return self if coarse is self.simulator else replace(self, simulator=coarse, settings=replace(self.settings, coarse=1))

    def quicker(self, effects: Sequence[Effect]) -> Windows:
        """The same, predicted with longer steps, and put right by what these change beside `effects`."""
        coarse, every = self.coarser(), np.arange(len(self))
        if coarse is self:
            return self
        fine, rough = (one._missed_from(self.shift, effects, every) for one in (self, coarse))
        return replace(coarse, offset=np.nan_to_num(fine - rough))

    def residuals(self, effects: Sequence[Effect], rows: Rows) -> Array:
        """What the simulator with `effects` misses, from the starts that are likeliest given both what was recorded at them and after them.

        How much of it another start explains is told by `slopes`, in proportion.

        Returns:
            What is missed of each coordinate at each row, in standard deviations of the noise, then how far the start lies from what was recorded of it,
            in standard deviations of that, shape (windows, rows · nv + 2 nv); cut off at the settings' `worst`, which also stands for a simulation that
            fails.
        """
        worst = self.settings.worst
        try:
            missed = np.nan_to_num(self._missed_from(self.shift[rows], effects, rows), nan=worst) + self.offset[rows]
        except UserError:
            return np.full((len(rows), self.slopes.shape[1] + self.slopes.shape[2]), worst)
        step = self._likelier(missed, rows)
        left = missed - np.einsum("wei,wi->we", self.slopes[rows], step)
        return np.asarray(np.clip(np.concatenate((left, (self.shift[rows] + step) / self.spread[rows]), 1), -worst, worst))

    def _likelier(self, missed: Array, rows: Rows) -> Array:
        """From the starts at `shift`, which miss `missed`, to the likeliest ones, shape (windows, 2 nv)."""
        slopes, trust = self.slopes[rows], 1 / self.spread[rows] ** 2
        # Across contacts what is missed by far tells of the simulator, not of the start.
        weighted = slopes / (1 + (missed / self.settings.pinned) ** 2)[..., None]
        gram = np.einsum("wei,wej->wij", weighted, slopes) + np.eye(slopes.shape[2]) * trust[:, None]
        against = np.einsum("wei,we->wi", weighted, missed) - trust * self.shift[rows]
        return np.asarray(np.linalg.solve(gram, against[..., None])[..., 0])

    def missed(self, path: Array, rows: Rows) -> Array:
        """What `path`, shape (windows, rows, nq + nv), misses of the coordinates, in standard deviations of the noise, shape (windows, rows · nv)."""
        layout = self.layout
        still = np.zeros((*path.shape[:2], layout.nv))
        off = layout.dx(layout.minus(layout.state(self.measured[rows], still), layout.state(layout.q(path), still)))
        return np.asarray((off / self.noise).reshape(len(path), -1))

    def linearised(self, effects: Sequence[Effect] = ()) -> Windows:
        """The same windows, with derivatives of the simulator with `effects` about the likeliest starts; twice, since starts as recorded may be far off."""
        found, every = self, np.arange(len(self))
        for central in (False, True):
            found = found._differenced(found._missed_from(found.shift, effects, every), effects, central)
        return found

    def sought(self, effects: Sequence[Effect] = ()) -> Windows:
        """The same windows from the likeliest starts to which the derivatives that they have lead: those of `imagined` ones are of where they really began."""
        found, every = self, np.arange(len(self))
        for _ in range(self.settings.sought):
            found = replace(found, shift=found._stepped(found._missed_from(found.shift, effects, every)))
        return found

    def relinearised(self, effects: Sequence[Effect], *, anew: bool = False) -> Windows:
        """The same windows linearised about what starts change beside `effects`, but for those of which more is missed from there: they jump.

        Args:
            anew: whether to go there from the starts as recorded, too, and to take what is nearer: from where another model led there may be no way.
        """
        every = np.arange(len(self))
        here = self._missed_from(self.shift, effects, every)
        best, least = self, self._cost(here, self.shift)
        others = [self._differenced(here, effects, central=True)]
        if anew:
            others.append(replace(self, shift=np.zeros_like(self.shift)).linearised(effects))
        for other in others:
            cost = self._cost(self._missed_from(other.shift, effects, every), other.shift)
            nearer = cost <= least
            shift = np.where(nearer[:, None], other.shift, best.shift)
            best, least = replace(best, shift=shift, slopes=np.where(nearer[:, None, None], other.slopes, best.slopes)), np.minimum(cost, least)
        return best

    def restarted(self, effects: Sequence[Effect]) -> Windows:
        """The same windows from the starts to which the derivatives that they have lead, but for those of which more is missed from there.

        Where effects have moved by little since they were linearised that is what `relinearised` leads to, for a few predictions in the place of dozens.
        """
        every = np.arange(len(self))
        here = self._missed_from(self.shift, effects, every)
        shift = self._stepped(here)
        nearer = self._cost(self._missed_from(shift, effects, every), shift) <= self._cost(here, self.shift)
        return replace(self, shift=np.where(nearer[:, None], shift, self.shift))

    def _cost(self, missed: Array, shift: Array) -> Array:
        """What `_likelier` lowers, where so much is `missed` from the starts at `shift`, shape (windows,)."""
        missed, pinned = np.nan_to_num(missed, nan=self.settings.worst), self.settings.pinned
        return np.asarray((pinned**2 * np.log1p((missed / pinned) ** 2)).sum(1) + ((shift / self.spread) ** 2).sum(1))

    def _differenced(self, missed: Array, effects: Sequence[Effect], central: bool) -> Windows:
        """The windows a step on from the starts at `shift`, which miss `missed`, with derivatives there.

        By differences as wide as the starts' spread, to one side or both: narrower ones would see the jerks of single contacts.
        """
        every, coarse, shift = np.arange(len(self)), self.coarser(), self._stepped(missed)

        def beside(step: Array) -> Array:
            return coarse._missed_from(shift + step, effects, every)

        here = None if central else beside(np.zeros_like(shift))
        slopes = np.empty_like(self.slopes)
        for direction in range(shift.shape[1]):
            step = np.zeros_like(shift)
            step[:, direction] = self.spread[:, direction]
            behind = beside(-step) if here is None else here
            slopes[..., direction] = (behind - beside(step)) / ((2 if central else 1) * self.spread[:, direction, None])
        return replace(self, shift=shift, slopes=np.nan_to_num(slopes))

    def _stepped(self, missed: Array) -> Array:
        """A step on from the starts at `shift`, which miss `missed`, shape (windows, 2 nv)."""
        # No start lies farther from what was recorded of it: what would go there is a mismatch, from where no answer to it finds back.
        most = self.settings.likely * self.spread
        return np.clip(self.shift + self._likelier(np.nan_to_num(missed), np.arange(len(self))), -most, most)

    def imagined(self, seed: int, effects: Sequence[Effect] = ()) -> Windows:
        """The same windows as the rig itself, or with `effects`, would make them, measured with the same noise: what nothing looks like.

        They are to be linearised about their own likeliest starts, as those of what was recorded are: derivatives do not reach across contacts. The
        derivatives that they have are of where they began.
        """
        rng, layout = np.random.default_rng(seed), self.layout
        path = self._rolled(effects, np.arange(len(self)), self.shift)
        off = np.zeros((*path.shape[:2], 2 * layout.nv))
        off[..., : layout.nv] = self.noise * rng.standard_normal(off[..., : layout.nv].shape)
        start = layout.plus(layout.plus(self.start, self.shift), self.spread * rng.standard_normal(self.spread.shape))
        return replace(self, measured=layout.q(layout.plus(path, off)), start=start, shift=np.zeros_like(self.shift))

    def from_recorded(self, effects: Sequence[Effect]) -> Array:
        """States from the starts as they were recorded, as `simulate` has them, shape (n, rows, nq + nv).

        Raises:
            UserError: if an effect cannot be installed, or the simulation fails.
        """
        return self._rolled(effects, np.arange(len(self)), np.zeros_like(self.shift))

    def _missed_from(self, shift: Array, effects: Sequence[Effect], rows: Rows) -> Array:
        """What the simulator with `effects` misses of the windows `rows` from their starts moved by `shift`, shape (windows, rows · nv)."""
        return self.missed(self._rolled(effects, rows, shift), rows)

    def _rolled(self, effects: Sequence[Effect], rows: Rows, shift: Array) -> Array:
        world = self.simulator.world(effects)
        starts = self.layout.plus(self.start[rows], shift)
        return np.array([self.simulator.rolled(world, start, self.u[row], self.past[row]) for row, start in zip(rows.tolist(), starts, strict=True)])


def unprimed(simulator: Simulator, settings: FreeSettings) -> int:
    """Rows of a recording in which no window begins: what motors held before it is not known."""
    return round(settings.primed / simulator.period) if simulator.rig.driven else 0


def windows_of(simulator: Simulator, recordings: Sequence[Recording], motions: Sequence[Motion], noise: Noise, settings: FreeSettings, total: int) -> Windows:
    """About `total` windows, evenly spread over the recordings, of those in which something moves; each starts at the first row near by that is calm.

    What they are to be linearised about is not known yet.

    Raises:
        UserError: if no recording is long enough.
    """
    layout, count = simulator.rig.layout, max(settings.fewest_rows, round(settings.window / simulator.period))
    # No farther on, lest a window begin where what slides has come to rest or to roll.
    reach = max(settings.fewest_rows, round(settings.calmest / simulator.period))
    begin, places = unprimed(simulator, settings), []
    for number, (one, motion) in enumerate(zip(recordings, motions, strict=True)):
        last = len(one.time) - 1 - count
        for slot in range(max(0, min(begin, last)), last + 1, count):
            near = np.arange(slot, min(slot + min(reach, count), last + 1))
            calm = near[motion.misfit[near] < settings.calm]
            row = int(calm[0] if len(calm) else near[np.argmin(motion.misfit[near])])
            moved = layout.dx(layout.minus(motion.state[row + 1 : row + 1 + count], motion.state[[row] * count])) / noise.q
            places.append((number, row, float(np.abs(moved).max())))
    if not places:
        raise UserError(f"{recordings[0].path}: no recording is longer than a window of {count + 1} rows; record for longer")
    # Few windows that move by far are no reason to leave out those that move less, as all do before noisy cameras.
    most = sorted((moved for _, _, moved in places), reverse=True)[: settings.few]
    least = min(settings.moved, max(settings.stirred, most[-1]))
    moving = [one for one in places if one[2] >= least] or places
    chosen = [moving[index] for index in np.unique(np.linspace(0, len(moving) - 1, min(total, len(moving))).round().astype(int))]
    pieces = []
    for number, row, _ in chosen:
        one, motion = recordings[number], motions[number]
        before, after = slice(max(0, row - simulator.remembered), row), slice(row + 1, row + 1 + count)
        pieces.append((one.u[row : row + count], (one.u[before], motion.state[before]), motion.state[row], motion.spread[row], one.q[after]))
    u, past, start, spread, measured = zip(*pieces, strict=True)
    numbers, rows, _ = zip(*chosen, strict=True)
    size = 2 * layout.nv
    return Windows(
        simulator,
        np.array(numbers),
        np.array(rows),
        np.array(u),
        past,
        np.array(start),
        np.array(spread),
        np.array(measured),
        noise.q,
        np.zeros((len(start), size)),
        np.zeros((len(start), count * layout.nv, size)),
        settings,
        np.zeros((len(start), count * layout.nv)),
    )
