"""Commands for a first recording: of many motions within stated limits those from which the parameters of most effects of the catalogue would be told best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.recording import write_table
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.experiment.catalogue import Seen, errors, in_one_unit, information, tried
from mpge_bench.diagnosis.experiment.motions import Limits, commanded
from mpge_bench.diagnosis.pipeline import Progress
from mpge_bench.envs.errors import UserError
from mpge_bench.rig.folder import TOLD

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Told:
    """How well an effect would be told beside all the others.

    Attributes:
        error: standard error of its parameter from the designed recordings, to first order about the rig as it believes itself to be; infinite where the
            others could make up for it.
        usual: the same from as many motions drawn at random within the limits.
    """

    effect: str
    target: str
    parameter: str
    unit: str
    error: float
    usual: float


def designed(
    rig: Rig, limits: Limits, seconds: float, recordings: int, draws: int, seed: int, jobs: int, progress: Progress
) -> tuple[list[Array], list[Told]]:
    """Commands of so many `recordings`, each shape (rows, joints), and how well effects would be told from them.

    Of `draws` random motions those are taken, one after another, that add most to the determinant of the information about all effects of the catalogue
    (D-optimal, greedily; Fedorov 1972; Swevers et al. 1997 for robots). It knows what is told apart, not only what is seen.

    Raises:
        UserError: if no motion stays within the limits.
    """
    progress.stage("trying motions", draws)
    found: list[Seen] = []
    with Workers(jobs) as workers:
        for first in range(0, draws, 4 * jobs):
            some = list(range(first, min(first + 4 * jobs, draws)))
            found += [one for one in workers.each(tried, (rig, limits, round(seconds / rig.record_period), seed), some) if one is not None]
            progress.advance(len(some))
    if len(found) < recordings:
        raise UserError(f"{rig.path}: of {draws} motions {len(found)} stay within the limits, and {recordings} are needed; give wider ones, or more --draws")
    grams, unit = in_one_unit(found)
    taken: list[int] = []
    total = np.zeros_like(grams[0])
    for _ in range(recordings):
        left = [index for index in range(len(found)) if index not in taken]
        best = max(left, key=lambda index: information(total + grams[index]))
        taken.append(best)
        total = total + grams[best]
    usual = np.median([errors(sum(grams[index : index + recordings], np.zeros_like(total))) for index in range(len(grams) - recordings + 1)], axis=0)
    told = []
    for effect, error, other in zip(found[0].effects, unit * errors(total), unit * usual, strict=True):
        name, parameter = next(iter(effect.parameters.items()))
        told.append(Told(effect.name, effect.target, name, parameter.unit_of(slide=rig.is_slide(effect.target)), float(error), float(other)))
    return [found[index].commands for index in taken], told


def write(rig: Rig, commands: Sequence[Array], told: Sequence[Told], out: Path) -> None:
    """excitation_00.csv and so on (time, u_<joint>), and told.csv, in `out`.

    Raises:
        UserError: if they cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    for index, one in enumerate(commands):
        write_table(commanded(rig, one), out / f"excitation_{index:02d}.csv")
    write_table(pd.DataFrame([vars(one) for one in told]), out / TOLD)
