"""Source and target side by side under one policy, as a GIF or MP4, drawn without a display."""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.util
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter1d

from mpge_bench.baselines.policy import Policy, load_state, policy_from
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.envs import RobotEnv, Task, get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import BASE_Q
from mpge_bench.envs.picture import Image as Pixels
from mpge_bench.policies import FOLDER, load_set
from mpge_bench.record import random_actions

Array = npt.NDArray[np.float64]

ENDINGS = (".gif", ".mp4")
#: Browsers slow GIFs down that are faster than this.
FASTEST = 50
#: How long the last picture is shown after both episodes have ended early, s; how slowly the camera follows, s.
_HOLD, _CALM = 1.0, 0.15
_INK, _FAINT, _PAPER = (31, 41, 51), (107, 119, 133), (255, 255, 255)
_SIDES = {"source": (0, 114, 178), "target": (190, 78, 0)}
_GAP = 2


@dataclass(frozen=True)
class RenderSettings:
    """What to render.

    Attributes:
        task: source/target pair.
        policy: ``source``: one of the source policies, which one says the seed; ``target``: so of the target-optimal ones; ``random``: smooth random actions;
            or the path of a .safetensors file. Policies act by their mean.
        seed: of the episode's start and of random actions.
        seconds: longest duration, s; not beyond the task's own length.
        width, height: of each side's picture, pixels.
        fps: pictures a second.
    """

    task: str
    policy: str = "source"
    seed: int = 0
    seconds: float = 5.0
    width: int = 400
    height: int = 300
    fps: int = 25


@dataclass(frozen=True)
class Episode:
    """One side's episode.

    Attributes:
        dt: control step, s.
        q: the state's positions at the beginning and after each control step, shape (steps + 1, size of q).
        returns: sum of the rewards up to then, shape (steps + 1,).
        ended: the task ended the episode (the robot fell, say).
    """

    dt: float
    q: Array
    returns: Array
    ended: bool

    @property
    def duration(self) -> float:
        """How long it lasts, s."""
        return self.dt * (len(self.q) - 1)

    def at(self, time: float) -> Array:
        """q at `time`, s, between control steps interpolated; after the end that of the end."""
        step = min(time / self.dt, len(self.q) - 1.0)
        before = int(step)
        here, there = self.q[before], self.q[min(before + 1, len(self.q) - 1)]
        return here + (step - before) * (there - here)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Film:
    """What was written: both episodes, how many pictures of what size (pixels), and how long it is, s."""

    source: Episode
    target: Episode
    frames: int
    size: tuple[int, int]
    duration: float


def render(settings: RenderSettings, out: Path, *, policy_folder: Path = FOLDER, progress: Progress | None = None) -> Film:
    """Let the policy act in source and target from the same seed, and write the film to `out`, a .gif or .mp4; a file that is there is replaced.

    An episode that the task ends early stays on its last picture; the film stops soon after both have.

    Raises:
        UserError: for wrong settings, a file of another kind or that cannot be written, a policy that is missing or of another robot, or MP4 without
            the packages that it needs.
    """
    progress = progress or Silent()
    if out.suffix.lower() not in ENDINGS:
        raise UserError(f"{out}: unknown kind of film {out.suffix!r}; choose a name that ends with {' or '.join(ENDINGS)}")
    if out.suffix.lower() == ".mp4" and not (importlib.util.find_spec("imageio") and importlib.util.find_spec("imageio_ffmpeg")):
        raise UserError(f"{out}: MP4 needs imageio and imageio-ffmpeg; get them by: pip install 'mpge_bench[video]', or write a .gif")
    task = get_task(settings.task)
    steps = min(int(np.floor(settings.seconds / task.robot.dt + 1e-6)), task.robot.episode_steps)
    if steps < 1:
        raise UserError(f"{settings.seconds} s is shorter than one control step of {task.robot.dt} s; give more --seconds")
    act = _actor(settings, task, steps, policy_folder)
    with _partial(out) as partial:
        environments = {"source": task.source(), "target": task.target()}
        episodes = {side: _episode(env, act, steps, settings.seed) for side, env in environments.items()}
        film = _Film(settings, task, environments, episodes)
        progress.stage(f"rendering {task.name}", film.count)

        def pictures() -> Iterator[Image.Image]:
            for frame in range(film.count):
                yield film.picture(frame)
                progress.advance(1)

        if out.suffix.lower() == ".gif":
            _write_gif(partial, film, pictures(), settings.fps)
        else:
            _write_mp4(partial, pictures(), settings.fps)
    return Film(episodes["source"], episodes["target"], film.count, film.size, film.duration)


def _actor(settings: RenderSettings, task: Task, steps: int, folder: Path) -> Callable[[int, Array], Array]:
    """What gives the action, shape (actuators,), by the control step's number and the observation."""
    robot, name = task.robot, settings.policy
    if name == "random":
        actions = random_actions(robot, steps, np.random.default_rng(settings.seed))
        return lambda step, observation: actions[step]
    if name in ("source", "target"):
        try:
            policies: Policy = load_set(task, name, folder)
        except UserError as error:
            raise UserError(f"{error}; --policy random needs none") from error
    elif name.endswith(".safetensors"):
        policies = policy_from(load_state(Path(name), robot.observation_size, len(robot.actuators)), robot.action_limit)
    else:
        raise UserError(f"unknown policy {name!r}; choose source, target, random or the path of a .safetensors file")
    member = np.array([settings.seed % len(policies)])
    return lambda step, observation: policies.best(observation[None], member)[0]


def _episode(env: RobotEnv, act: Callable[[int, Array], Array], steps: int, seed: int) -> Episode:
    observation, _ = env.reset(seed=seed)
    states, returns, ended = [env.world.q], [0.0], False
    for step in range(steps):
        observation, reward, ended, _, _ = env.step(act(step, observation))
        states.append(env.world.q)
        returns.append(returns[-1] + reward)
        if ended:
            break
    q = np.array(states)
    if env.world.floating:
        # A quaternion and its negative are one orientation: the nearer one is what motion can be interpolated to.
        turn = q[:, 3:BASE_Q]
        turn[1:] *= np.cumprod(np.where(np.sum(turn[1:] * turn[:-1], 1) < 0, -1.0, 1.0))[:, None]
    return Episode(env.robot.dt, q, np.array(returns), ended)


@contextlib.contextmanager
def _partial(out: Path) -> Iterator[Path]:
    """A file beside `out` that takes its place in the end; where anything goes wrong, it and the folders made for it are removed."""
    partial = out.with_name(f".{out.stem}.{os.getpid()}{out.suffix.lower()}")
    made = [folder for folder in out.parents if not folder.exists()]
    try:
        if out.is_dir():
            raise UserError(f"{out}: is a folder; choose another name with --out")
        out.parent.mkdir(parents=True, exist_ok=True)
        partial.touch()
        yield partial
        partial.replace(out)
    except BaseException as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
            for folder in made:
                folder.rmdir()
        if isinstance(error, OSError):
            raise UserError(f"{out}: cannot be written ({error.strerror or error}); choose another place with --out") from error
        raise


class _Film:
    """The pictures, each drawn when it is asked for."""

    def __init__(self, settings: RenderSettings, task: Task, environments: dict[str, RobotEnv], episodes: dict[str, Episode]) -> None:
        self._task, self._settings, self._episodes = task, settings, episodes
        longest = max(episode.duration for episode in episodes.values())
        held = _HOLD if all(episode.ended for episode in episodes.values()) else 0.0
        self.duration = min(longest + held, max(settings.seconds, longest))
        self.count = round(self.duration * settings.fps) + 1
        self._times = np.arange(self.count) / settings.fps
        self._views = {side: env.robot.world(env.effects, seen=True) for side, env in environments.items()}
        rooms = [env.robot.room(env.effects) for env in environments.values()]
        # Both sides are seen from equally far away.
        room = np.min([low for low, _ in rooms], 0), np.max([high for _, high in rooms], 0)
        self._cameras = {side: self._path(task, episode, room) for side, episode in episodes.items()}
        self._digits = 2 if max(np.abs(episode.returns).max() for episode in episodes.values()) < 10 else 1
        size = self._letter = min(max(round(settings.width / 28), 9), 30)
        self._plain, self._bold = _font("DejaVuSans", size), _font("DejaVuSans-Bold", size)
        whole = 2 * settings.width + _GAP
        differs = task.summary or ", ".join(f"{effect.name} on {effect.target}" for effect in task.effects)
        self._caption = _lines(f"target: {differs}", self._plain, whole - size, 2)
        self._top, self._line = 4 * size, round(1.5 * size)
        below = self._line * len(self._caption) + size // 2
        # Even, as video codecs want it.
        self.size = whole, 2 * ((self._top + settings.height + below + 1) // 2)
        self._last: dict[str, tuple[float, Image.Image]] = {}

    def _path(self, task: Task, episode: Episode, room: tuple[Array, Array]) -> list[dict[str, Any]]:
        """The camera at each picture: it follows the robot without its jolts."""
        cameras = [task.robot.camera(episode.at(time), room) for time in self._times]
        calm = gaussian_filter1d([camera["at"] for camera in cameras], _CALM * self._settings.fps, 0, mode="nearest")
        return [{**camera, "at": at} for camera, at in zip(cameras, calm.tolist(), strict=True)]

    def picture(self, frame: int) -> Image.Image:
        """Picture number `frame`, both sides with their labels."""
        settings, letter, time = self._settings, self._letter, float(self._times[frame])
        canvas = Image.new("RGB", self.size, _PAPER)
        draw = ImageDraw.Draw(canvas)
        margin, whole = letter // 2, self.size[0]
        shown = max(min(time, episode.duration) for episode in self._episodes.values())
        clock = f"{shown:.2f} s"
        draw.text((whole - margin, letter), clock, _INK, self._plain, "rm")
        draw.text((margin, letter), self._task.name, _INK, self._bold, "lm")
        used = 2 * margin + letter + self._bold.getlength(self._task.name)
        policy = f"{_policy_name(settings.policy)}, seed {settings.seed}"
        draw.text((used, letter), _fit(policy, self._plain, whole - used - self._plain.getlength(clock) - 2 * letter), _FAINT, self._plain, "lm")
        for place, (side, episode) in enumerate(self._episodes.items()):
            left = place * (settings.width + _GAP)
            row = 3 * letter
            draw.text((left + margin, row), side, _SIDES[side], self._bold, "lm")
            paid = f"return {episode.returns[min(round(time / episode.dt), len(episode.returns) - 1)]:.{self._digits}f}"
            draw.text((left + settings.width - margin, row), paid, _INK, self._plain, "rm")
            canvas.paste(self._side(side, frame), (left, self._top))
        for line, text in enumerate(self._caption):
            draw.text((margin, self._top + settings.height + margin + self._line * line), text, _FAINT, self._plain, "la")
        return canvas

    def _side(self, side: str, frame: int) -> Image.Image:
        episode, time = self._episodes[side], float(self._times[frame])
        over = episode.ended and time >= episode.duration
        if over:
            # The camera stands still, too, from the episode's last picture on.
            frame = min(frame, int(np.searchsorted(self._times, episode.duration)))
        if side in self._last and self._last[side][0] == frame:
            return self._last[side][1]
        view, settings = self._views[side], self._settings
        q = episode.at(float(self._times[frame]))
        view.set_state(q, np.zeros_like(view.dq))
        pixels: Pixels = view.render(settings.width, settings.height, **self._cameras[side][frame])
        image = Image.fromarray(pixels)
        if over:
            image = Image.blend(image, Image.new("RGB", image.size, _PAPER), 0.4)
            text = f"ended at {episode.duration:.2f} s"
            draw = ImageDraw.Draw(image)
            middle = settings.width / 2, 1.5 * self._letter
            left, upper, right, lower = draw.textbbox(middle, text, self._bold, "mm")
            pad = self._letter // 2
            draw.rounded_rectangle((left - pad, upper - pad, right + pad, lower + pad), pad, fill=_INK)
            draw.text(middle, text, _PAPER, self._bold, "mm")
        self._last[side] = frame, image
        return image


@functools.cache
def _font(name: str, size: int) -> ImageFont.FreeTypeFont:
    # matplotlib brings these along, so that pictures look alike everywhere and know → and ².
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{name}.ttf"), size)


def _policy_name(policy: str) -> str:
    if policy in ("source", "target"):
        return f"{policy} policy" if policy == "source" else "target-optimal policy"
    return "random actions" if policy == "random" else policy


def _fit(text: str, font: ImageFont.FreeTypeFont, width: float) -> str:
    """`text`, shortened to `width` pixels."""
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…" if text else ""


def _lines(text: str, font: ImageFont.FreeTypeFont, width: float, most: int) -> list[str]:
    """`text` in at most `most` lines of `width` pixels."""
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and (font.getlength(longer) <= width or len(lines) == most):
            lines[-1] = longer
        else:
            lines.append(word)
    return [_fit(line, font, width) for line in lines]


def _write_gif(path: Path, film: _Film, pictures: Iterator[Image.Image], fps: int) -> None:
    # One palette for all pictures: what does not move stays the same and costs nothing. Rare colours (the robot's) count for more than their pixels.
    frames = np.unique(np.linspace(0, film.count - 1, 6).astype(int)).tolist()
    pixels = np.concatenate([np.asarray(film.picture(frame), np.uint32).reshape(-1, 3) for frame in frames])
    packed, counts = np.unique(pixels @ np.array([1 << 16, 1 << 8, 1], np.uint32), return_counts=True)
    often = np.repeat(packed, np.rint(counts**0.25).astype(int))
    colours = np.stack([often >> 16, often >> 8 & 255, often & 255], 1).astype(np.uint8)
    palette = Image.fromarray(colours[None]).quantize(255, Image.Quantize.MEDIANCUT, kmeans=2)
    reduced = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    # GIF counts hundredths of a second; rounded so that the whole film keeps its time.
    ticks = np.diff(np.rint(np.arange(film.count + 1) * 100 / fps).astype(int))
    first = next(reduced)
    first.save(path, "GIF", save_all=True, append_images=reduced, duration=(10 * ticks).tolist(), loop=0)


def _write_mp4(path: Path, pictures: Iterator[Image.Image], fps: int) -> None:
    # Optional, hence not imported above.
    imageio = importlib.import_module("imageio.v2")
    with imageio.get_writer(path, format="FFMPEG", mode="I", fps=fps, codec="libx264", quality=7, macro_block_size=2, ffmpeg_log_level="error") as writer:
        for picture in pictures:
            writer.append_data(np.asarray(picture))
