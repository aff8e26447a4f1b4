"""Effects on the links of the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mpge_bench.envs.effects.effect import Effect, Parameter

if TYPE_CHECKING:
    from mpge_bench.envs.world import World


@dataclass(frozen=True)
class MassScale(Effect):
    """The link (``"*"``: every link) is `factor` times as dense: its mass and its rotational inertia grow alike, its shape stays.

    Rotors (`World`'s armature) are links of their own and stay as they are.
    """

    factor: float

    name = "mass_scale"
    on = "link"
    parameters = {"factor": Parameter("1", 0.05, 50.0)}

    def install(self, world: World) -> None:
        for link in world.links if self.target == "*" else (self.target,):
            world.scale_mass(link, self.factor)
