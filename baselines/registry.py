"""The methods by name. A method's module is read when the method is asked for: nobody waits for what is not used."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from typing import Any

from mpge_bench.baselines.method import ACCESS, Method
from mpge_bench.baselines.presets import load_settings, presets_of
from mpge_bench.envs.custom import import_object
from mpge_bench.envs.errors import UserError

#: Module and class of each of our methods, references first.
ADDRESSES = {
    "direct": "mpge_bench.baselines.direct:Direct",
    "target_optimal": "mpge_bench.baselines.direct:TargetOptimal",
    "perfect": "mpge_bench.baselines.direct:Perfect",
    "ane": "mpge_bench.baselines.ane:ANE",
    "rarl": "mpge_bench.baselines.rarl:RARL",
    "randomization": "mpge_bench.baselines.randomization:Randomization",
    "gat": "mpge_bench.baselines.gat:GAT",
    "garat": "mpge_bench.baselines.garat:GARAT",
    "mpg": "mpge_bench.baselines.mpg:MPG",
    "mpge": "mpge_bench.baselines.mpge:MPGE",
    "inversion": "mpge_bench.baselines.inversion:Inversion",
    "sysid": "mpge_bench.repair:Identification",
    "diagnose": "mpge_bench.repair:Repair",
    "darc": "mpge_bench.baselines.darc:DARC",
    "finetune": "mpge_bench.baselines.finetune:FineTune",
    "scratch": "mpge_bench.baselines.multipolar:Scratch",
    "rpl": "mpge_bench.baselines.multipolar:RPL",
    "multipolar": "mpge_bench.baselines.multipolar:Multipolar",
}


def methods() -> dict[str, Method]:
    """Our methods by name, references first."""
    return {name: get_method(name) for name in ADDRESSES}


def get_method(name: str) -> Method:
    """The method called `name`, or a user's own: ``my_package.mine:MyMethod``.

    Raises:
        UserError: if there is none, or the user's own is no `Method`.
    """
    if name not in ADDRESSES and ":" not in name:
        raise UserError(f"unknown method {name!r}; choose one of: {', '.join(ADDRESSES)}; or give your own: my_package.mine:MyMethod")
    return _import(ADDRESSES.get(name, name))


def described(name: str) -> dict[str, Any]:
    """All that is known of a method, as plain data: where it is from, what it may use, and its settings under the preset standard where no pair changes them.

    Raises:
        UserError: as `get_method`.
    """
    method = get_method(name)
    return {
        "name": name,
        "summary": method.summary,
        "citation": method.citation,
        "access": sorted(method.access),
        "samples": method.samples,
        "presets": presets_of(method.preset),
        "settings": dataclasses.asdict(load_settings(method.settings, method.preset, "standard")),
    }


@functools.cache
def _import(address: str) -> Method:
    what = "a subclass of mpge_bench.baselines.method.Method"
    found = import_object(address, what)
    if not (inspect.isclass(found) and issubclass(found, Method)) or inspect.isabstract(found):
        raise UserError(f"{address}: is not {what} with a `train` of its own")
    if not dataclasses.is_dataclass(found.settings):
        raise UserError(f"{address}: its `settings` is no dataclass")
    unknown = sorted(map(str, set(found.access) - ACCESS.keys()))
    if unknown:
        raise UserError(f"{address}: its `access` says {', '.join(unknown)}; the words there are: {', '.join(ACCESS)}")
    try:
        return found()
    except TypeError as error:
        raise UserError(f"{address}: cannot be made without arguments ({error})") from error
