"""Films of robots side by side, each in a picture with its name above it, as a GIF or MP4, drawn without a display."""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.util
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter1d

from mpge_bench.baselines.progress import Progress
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import BASE_Q
from mpge_bench.envs.picture import Image as Pixels
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]

ENDINGS = (".gif", ".mp4")
#: Of the names of sides.
BLUE, ORANGE, GREEN = (0, 114, 178), (190, 78, 0), (0, 120, 90)
_INK, _FAINT, _PAPER = (31, 41, 51), (107, 119, 133), (255, 255, 255)
_GAP = 2
#: How slowly a camera follows, s.
_CALM = 0.15


@dataclass(frozen=True)
class Format:
    """What a film looks like: width and height of each side's picture, pixels, and pictures a second (browsers slow down GIFs of more than 50)."""

    width: int = 400
    height: int = 300
    fps: int = 25


@dataclass(frozen=True)
class Side:
    """What is seen in one picture of each of the film's.

    Attributes:
        name: above it, in `colour`.
        at: coordinates of the robot by time, s.
        view: made to be seen, with the robot in it.
        cameras: from where it is looked at, as `World.render` takes it, one a picture.
        note: what is said above it, to the right, by time, s.
        ended: when it ended early, s: from then on it stays as it is, paler.
    """

    name: str
    colour: tuple[int, int, int]
    at: Callable[[float], Array]
    view: World
    cameras: Sequence[dict[str, Any]]
    note: Callable[[float], str]
    ended: float | None = None


@dataclass(frozen=True)
class Labels:
    """What is written on all pictures: at the top the title and, fainter, what belongs to it; below, the caption."""

    title: str
    beside: str
    caption: str


@dataclass(frozen=True)
class Written:
    """A film that was written: how many pictures of what size (pixels), and how long it is, s."""

    frames: int
    size: tuple[int, int]
    duration: float


def check_film(out: Path) -> None:
    """Raise a UserError if no film can be called so, or the packages for it are missing."""
    if out.suffix.lower() not in ENDINGS:
        raise UserError(f"{out}: unknown kind of film {out.suffix!r}; choose a name that ends with {' or '.join(ENDINGS)}")
    if out.suffix.lower() == ".mp4" and not (importlib.util.find_spec("imageio") and importlib.util.find_spec("imageio_ffmpeg")):
        raise UserError(f"{out}: MP4 needs imageio and imageio-ffmpeg; get them by: pip install 'mpge_bench[video]', or write a .gif")


def times(duration: float, fps: int) -> Array:
    """When the pictures of a film of `duration` s are, s."""
    return np.arange(round(duration * fps) + 1) / fps


def followed(cameras: Sequence[dict[str, Any]], fps: int) -> list[dict[str, Any]]:
    """Cameras, one a picture, that follow what these look at without its jolts."""
    calm = gaussian_filter1d([camera["at"] for camera in cameras], _CALM * fps, 0, mode="nearest")
    return [{**camera, "at": at} for camera, at in zip(cameras, calm.tolist(), strict=True)]


def one_way(q: Array) -> Array:
    """Coordinates of a floating base, shape (rows, size of q), with the quaternions' signs so that motion can be interpolated from row to row.

    A quaternion and its negative are one orientation: the nearer one is what motion can be interpolated to.
    """
    turned = q.copy()
    turn = turned[:, 3:BASE_Q]
    turn[1:] *= np.cumprod(np.where(np.sum(turn[1:] * turn[:-1], 1) < 0, -1.0, 1.0))[:, None]
    return turned


@contextlib.contextmanager
def partial_film(out: Path) -> Iterator[Path]:
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


class Film:
    """The pictures, each drawn when it is asked for.

    Args:
        duration: s.
        moves_for: how long anything moves, s, after which the clock stands still.
    """

    def __init__(self, sides: Sequence[Side], labels: Labels, form: Format, duration: float, moves_for: float) -> None:
        self._sides, self._labels, self._form, self._moves_for = sides, labels, form, moves_for
        self.duration = duration
        self._times = times(duration, form.fps)
        self.count = len(self._times)
        size = self._letter = min(max(round(form.width / 28), 9), 30)
        self._plain, self._bold = _font("DejaVuSans", size), _font("DejaVuSans-Bold", size)
        whole = len(sides) * form.width + (len(sides) - 1) * _GAP
        self._caption = _lines(labels.caption, self._plain, whole - size, 2)
        self._top, self._line = 4 * size, round(1.5 * size)
        below = self._line * len(self._caption) + size // 2
        # Even, as video codecs want it.
        self.size = whole + whole % 2, 2 * ((self._top + form.height + below + 1) // 2)
        self._last: dict[str, tuple[float, Image.Image]] = {}

    def write(self, path: Path, progress: Progress) -> Written:
        """Write the film to `path`, a GIF or, by its name, MP4."""

        def pictures() -> Iterator[Image.Image]:
            for frame in range(self.count):
                yield self.picture(frame)
                progress.advance(1)

        if path.suffix == ".gif":
            _write_gif(path, self, pictures(), self._form.fps)
        else:
            _write_mp4(path, pictures(), self._form.fps)
        return Written(self.count, self.size, self.duration)

    def picture(self, frame: int) -> Image.Image:
        """Picture number `frame`, all sides with their labels."""
        labels, letter, time, width = self._labels, self._letter, float(self._times[frame]), self._form.width
        canvas = Image.new("RGB", self.size, _PAPER)
        draw = ImageDraw.Draw(canvas)
        margin, whole = letter // 2, self.size[0]
        clock = f"{min(time, self._moves_for):.2f} s"
        draw.text((whole - margin, letter), clock, _INK, self._plain, "rm")
        title = _fit(labels.title, self._bold, whole - self._plain.getlength(clock) - 2 * letter)
        draw.text((margin, letter), title, _INK, self._bold, "lm")
        used = 2 * margin + letter + self._bold.getlength(title)
        draw.text((used, letter), _fit(labels.beside, self._plain, whole - used - self._plain.getlength(clock) - 2 * letter), _FAINT, self._plain, "lm")
        for place, side in enumerate(self._sides):
            left = place * (width + _GAP)
            row = 3 * letter
            draw.text((left + margin, row), side.name, side.colour, self._bold, "lm")
            room = width - 3 * margin - self._bold.getlength(side.name)
            draw.text((left + width - margin, row), _fit(side.note(time), self._plain, room), _INK, self._plain, "rm")
            canvas.paste(self._side(side, frame), (left, self._top))
        for line, text in enumerate(self._caption):
            draw.text((margin, self._top + self._form.height + margin + self._line * line), text, _FAINT, self._plain, "la")
        return canvas

    def _side(self, side: Side, frame: int) -> Image.Image:
        over = side.ended is not None and float(self._times[frame]) >= side.ended
        if side.ended is not None and over:
            # The camera stands still, too, from the episode's last picture on.
            frame = min(frame, int(np.searchsorted(self._times, side.ended)))
        if side.name in self._last and self._last[side.name][0] == frame:
            return self._last[side.name][1]
        q = side.at(float(self._times[frame]))
        side.view.set_state(q, np.zeros_like(side.view.dq))
        pixels: Pixels = side.view.render(self._form.width, self._form.height, **side.cameras[frame])
        image = Image.fromarray(pixels)
        if over:
            image = self._paled(image, f"ended at {side.ended:.2f} s")
        self._last[side.name] = frame, image
        return image

    def _paled(self, image: Image.Image, text: str) -> Image.Image:
        image = Image.blend(image, Image.new("RGB", image.size, _PAPER), 0.4)
        draw = ImageDraw.Draw(image)
        middle = self._form.width / 2, 1.5 * self._letter
        left, upper, right, lower = draw.textbbox(middle, text, self._bold, "mm")
        pad = self._letter // 2
        draw.rounded_rectangle((left - pad, upper - pad, right + pad, lower + pad), pad, fill=_INK)
        draw.text(middle, text, _PAPER, self._bold, "mm")
        return image


@functools.cache
def _font(name: str, size: int) -> ImageFont.FreeTypeFont:
    # matplotlib brings these along, so that pictures look alike everywhere and know → and ².
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{name}.ttf"), size)


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


def _write_gif(path: Path, film: Film, pictures: Iterator[Image.Image], fps: int) -> None:
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
