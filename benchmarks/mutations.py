"""Files spoilt on purpose: what an accident does to a file, and what somebody writes into one who means harm.

`spoilt` draws one change of a file of a given form from a seeded generator. No mutation is written down: the same seed makes the same files. Whoever loads
them with the folder of `canary` as working directory finds a file called `TOUCHED` in it where one of them had its code run.
"""

from __future__ import annotations

import copy
import io
import json
import pickle
import random
import re
import struct
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

#: A module that a file may name, and what it writes when it is imported; pickles and tags write the same.
MODULE, TOUCHED = "hostile_canary", "touched"
#: Longest text, deepest nesting, rows and bytes of what grows when it is unpacked.
LONG, DEEP, BOMB = 1_000_000, 100_000, 40_000_000
#: Stands for what no writer of JSON or YAML would write, and is replaced in the text.
_PLACE = "qXhostileXq"
#: What a number, a text or a whole branch is replaced by.
VALUES: tuple[Any, ...] = (
    *(None, True, False, -1, 0, 1, 0.5, 10**30, -(10**30), 2**63, 1e308, -1e308, 5e-324, float("nan"), float("inf"), float("-inf")),
    *("", " ", "nan", "-1", "1e400", "\x00", "two\nlines", "\x1b[2J\x1b[31mred", "\ud800", "[/red]", "broken_hopper@nan", "multipolar_hopper_²"),
    "x" * LONG,
    *("../../../../etc/passwd", "/etc/passwd", "/dev/zero", "/", ".", "file:///etc/passwd", f"{MODULE}:PAIR", "os:system"),
    *("{0.__class__}", "%s%n", "$(id)"),
    *([], {}, [[]], {"": None}, [None], [1, "two", [3]], {"a": {"b": {"c": []}}}, list(range(5000))),
)
#: Texts that stand for a value as they are.
_JSON_TEXTS = ("NaN", "Infinity", "1e400", "9" * 5000, "[" * DEEP + "]" * DEEP, '{"a":' * DEEP + "1" + "}" * DEEP, "0x10", "'single'", "undefined", "-")
_YAML_TEXTS = (
    *(".nan", "-.inf", "1e400", "9" * 5000, "[" * 5000 + "]" * 5000, "{a: " * 5000 + "1" + "}" * 5000, "2001-13-40", "12:99:00", "0o17", "~", "!!null x"),
    *("!!binary '%%%'", "!!set {a, b}", "!!timestamp x", "!!int x", "!!float x", "!unknown x", "*nowhere", "? [a, b] : c", '"\\ud800"'),
    *("&itself [*itself]", "&itself {a: *itself}"),
    f"!!python/object/apply:os.system ['touch {TOUCHED}']",
    f"!!python/object/new:subprocess.Popen [['touch', '{TOUCHED}']]",
    f"!!python/module:{MODULE}",
    f"!!python/name:{MODULE}.PAIR",
)


class Payload:
    """Unpickled, it touches the canary."""

    def __reduce__(self) -> tuple[Any, ...]:
        import os

        return os.system, (f"touch {TOUCHED}",)


def canary(folder: Path, *, module: bool = True) -> Path:
    """The file that is in `folder` once any code of a file was run; put the module that files name there, too."""
    if module:
        (folder / f"{MODULE}.py").write_text(f"open({str(folder / TOUCHED)!r}, 'w').close()\nPAIR = None\n")
    return folder / TOUCHED


def spoilt(data: bytes, form: str, rng: random.Random) -> tuple[str, bytes]:
    """What was done, and the file of `form` (a key of `FORMS`) after it."""
    while True:
        name, change = rng.choice(FORMS[form])
        try:
            changed = change(data, rng)
        except (ValueError, TypeError, LookupError):  # nothing there to do this to
            continue
        if changed != data:
            return name, changed


# Bytes: what disks, cables and interrupted copies do.


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data))]


def _flipped(data: bytes, rng: random.Random) -> bytes:
    found = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def _stretch(data: bytes, rng: random.Random) -> tuple[int, int]:
    at = rng.randrange(len(data))
    return at, min(len(data), at + rng.choice((1, 4, 16, 256)))


def _zeroed(data: bytes, rng: random.Random) -> bytes:
    low, high = _stretch(data, rng)
    return data[:low] + bytes(high - low) + data[high:]


def _lost(data: bytes, rng: random.Random) -> bytes:
    low, high = _stretch(data, rng)
    return data[:low] + data[high:]


def _twice(data: bytes, rng: random.Random) -> bytes:
    low, high = _stretch(data, rng)
    return data[:high] + data[low:high] + data[high:]


def _noise(data: bytes, rng: random.Random) -> bytes:
    low, high = _stretch(data, rng)
    return data[:low] + rng.randbytes(high - low) + data[high:]


def _other(data: bytes, rng: random.Random) -> bytes:
    """A file of another kind under this name."""
    others = (b"", b"\n", b"\0" * 64, b"\xff\xfe" * 32, b"null", b"[]", b"{}", b"<a/>", b"PK\x03\x04", b"PAR1PAR1", pickle.dumps(Payload()), _torch_file())
    return rng.choice(others)


def _torch_file() -> bytes:
    """What torch.save would write of an object that runs code when it is loaded."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("archive/data.pkl", pickle.dumps(Payload()))
        archive.writestr("archive/version", "3\n")
    return file.getvalue()


# Texts, line by line.


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.decode().splitlines(keepends=True)
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    how = rng.randrange(6)
    if how == 0:
        del lines[at]
    elif how == 1:
        lines.insert(other, lines[at])
    elif how == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif how == 3:
        lines[at] = "    " + lines[at] if rng.random() < 0.5 else "\t" + lines[at]
    elif how == 4:
        lines[at] = lines[at][: len(lines[at]) // 2] + "\n"
    else:
        lines.insert(at, rng.choice(("\0\n", "]\n", "- }\n", "%YAML 9.9\n", "---\n", "...\n", "<<<<<<< HEAD\n", "a: b: c\n", f"{'z' * LONG}\n")))
    return "".join(lines).encode()


def _coded(data: bytes, rng: random.Random) -> bytes:
    coding = rng.choice(("utf-16", "utf-32", "utf-8-sig", "cp500"))
    return data.decode().encode(coding, "replace")


def _word(data: bytes, rng: random.Random) -> bytes:
    """A word or a number of the text replaced."""
    text = data.decode()
    found = rng.choice(list(re.finditer(r"[\w.+-]+", text)))
    value = rng.choice([*map(str, VALUES), *_YAML_TEXTS])
    return (text[: found.start()] + value + text[found.end() :]).encode()


# Trees of mappings and lists: JSON, YAML, and the header of a safetensors file.


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every (parent, key) of a tree."""
    for key in list(tree if isinstance(tree, dict) else range(len(tree))):
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from _places(tree[key])


def _replaced(tree: Any, rng: random.Random, values: tuple[Any, ...] = VALUES) -> None:
    parent, key = rng.choice(list(_places(tree)))
    parent[key] = copy.deepcopy(rng.choice(values))


def _deleted(tree: Any, rng: random.Random) -> None:
    parent, key = rng.choice(list(_places(tree)))
    del parent[key]


def _moved(tree: Any, rng: random.Random) -> None:
    """Two branches change places."""
    (one, first), (other, second) = rng.sample(list(_places(tree)), 2)
    one[first], other[second] = copy.deepcopy(other[second]), copy.deepcopy(one[first])


def _renamed(tree: Any, rng: random.Random) -> None:
    parent, key = rng.choice([place for place in _places(tree) if isinstance(place[0], dict)])
    value = parent.pop(key)
    parent[rng.choice(("unknown", "", "../../x", f"{MODULE}:PAIR", "__class__", "\n", "a.b", "self", "x" * 1000, str(key).upper()))] = value


def _numbered(tree: Any, rng: random.Random) -> None:
    """Another number, large, small or of another sign, where there was one."""
    parent, key = rng.choice([place for place in _places(tree) if isinstance(place[0][place[1]], int | float)])
    near = (-parent[key], parent[key] * 1000, parent[key] / 1000, str(parent[key]))
    parent[key] = rng.choice([*(value for value in VALUES if isinstance(value, int | float)), *near])


def _versioned(tree: Any, rng: random.Random) -> None:
    """Another schema, or one where there is none."""
    stem, _, number = str(tree.get("schema", "mpge_bench/run/2")).rpartition("/")
    names = (f"{stem}/{int(number) + 1}", f"{stem}/0", f"{stem}/1", f"{stem}/x", "other/thing/1", stem, f"{stem}/{10**30}")
    tree["schema"] = rng.choice((*names, 2, None, [], ""))


_TREES: tuple[tuple[str, Callable[[Any, random.Random], None]], ...] = (
    ("value replaced", _replaced),
    ("number replaced", _numbered),
    ("branch deleted", _deleted),
    ("branches exchanged", _moved),
    ("key renamed", _renamed),
    ("schema", _versioned),
)


def _as_json(change: Callable[[Any, random.Random], None]) -> Callable[[bytes, random.Random], bytes]:
    def changed(data: bytes, rng: random.Random) -> bytes:
        tree = json.loads(data)
        change(tree, rng)
        return json.dumps(tree, indent=1).encode()

    return changed


def _as_yaml(change: Callable[[Any, random.Random], None]) -> Callable[[bytes, random.Random], bytes]:
    def changed(data: bytes, rng: random.Random) -> bytes:
        tree = yaml.safe_load(data)
        change(tree, rng)
        return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True).encode()

    return changed


def _text_put(texts: tuple[str, ...], wrapped: Callable[..., Any]) -> Callable[[bytes, random.Random], bytes]:
    """A value replaced by text as it is, which no writer would write."""

    def changed(data: bytes, rng: random.Random) -> bytes:
        marked: bytes = wrapped(lambda tree, draws: _replaced(tree, draws, (_PLACE,)))(data, rng)
        return re.sub(rf'"?{_PLACE}"?', lambda _: rng.choice(texts), marked.decode()).encode()

    return changed


def _laughing(data: bytes, rng: random.Random) -> bytes:
    """Aliases of aliases: a few lines that are ten to the ninth values, as a list, as a mapping, or merged."""
    kind = rng.randrange(3)
    if kind == 0:
        bomb = ["l0: &l0 [lol, lol]", *(f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 10)}]" for n in range(1, 10))]
    elif kind == 1:
        bomb = ["l0: &l0 {a: lol}", *(f"l{n}: &l{n} {{{', '.join(f'k{k}: *l{n - 1}' for k in range(10))}}}" for n in range(1, 10))]
    else:
        bomb = ["l0: &l0 {a: lol}", *(f"l{n}: &l{n} {{<<: [{', '.join([f'*l{n - 1}'] * 10)}]}}" for n in range(1, 10))]
    tree = yaml.safe_load(data)
    parent, key = rng.choice(list(_places(tree)))
    parent[key] = _PLACE
    return ("\n".join(bomb) + "\n" + yaml.safe_dump(tree, sort_keys=False).replace(_PLACE, "*l9")).encode()


# Safetensors: eight bytes that say how long the header is, a header in JSON, numbers.


def _split(data: bytes) -> tuple[dict[str, Any], bytes]:
    size = struct.unpack("<Q", data[:8])[0]
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def _joined(header: Any, body: bytes) -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def _in_header(change: Callable[[Any, random.Random], None]) -> Callable[[bytes, random.Random], bytes]:
    def changed(data: bytes, rng: random.Random) -> bytes:
        header, body = _split(data)
        change(header, rng)
        return _joined(header, body)

    return changed


def _header_size(data: bytes, rng: random.Random) -> bytes:
    return struct.pack("<Q", rng.choice((0, 1, 2**63, 2**64 - 1, 100_000_000, len(data)))) + data[8:]


def _reshaped(data: bytes, rng: random.Random) -> bytes:
    """A tensor with another shape of as many numbers, or of another type of as many bytes."""
    header, body = _split(data)
    name = rng.choice([name for name in header if name != "__metadata__"])
    shape, count = header[name]["shape"], int(np.prod(header[name]["shape"]))
    header[name]["shape"] = rng.choice((shape[::-1], [count], [1, *shape], [count, 1], [*shape, 1], [1, count]))
    if header[name]["shape"] == shape:
        header[name]["dtype"] = rng.choice([kind for kind in ("F32", "I32", "U32") if kind != header[name]["dtype"]])
    return _joined(header, body)


def _absurd_shape(data: bytes, rng: random.Random) -> bytes:
    header, body = _split(data)
    name = rng.choice([name for name in header if name != "__metadata__"])
    header[name]["shape"] = rng.choice(([2**40], [2**32, 2**32], [-1], [0], [], [2**62, 0], ["a"], [1.5]))
    return _joined(header, body)


def _numbers_put(data: bytes, rng: random.Random) -> bytes:
    """NaN, infinite, huge or tiny numbers in place of some of a tensor's."""
    header, body = _split(data)
    name = rng.choice([name for name in header if name != "__metadata__" and header[name]["dtype"] == "F32"])
    low, high = header[name]["data_offsets"]
    values = np.frombuffer(body[low:high], np.float32).copy()
    values[rng.randrange(len(values)) if rng.random() < 0.5 else slice(None)] = rng.choice((np.nan, np.inf, -np.inf, 3e38, -3e38, 0.0, 1e-45))
    return _joined(header, body[:low] + values.tobytes() + body[high:])


def _one_less(data: bytes, rng: random.Random) -> bytes:
    """A tensor left out, and the others moved up."""
    header, body = _split(data)
    gone = rng.choice([name for name in header if name != "__metadata__"])
    kept, parts, at = {key: value for key, value in header.items() if key != gone}, [], 0
    for name, entry in sorted(((name, entry) for name, entry in kept.items() if name != "__metadata__"), key=lambda one: one[1]["data_offsets"]):
        low, high = entry["data_offsets"]
        parts.append(body[low:high])
        kept[name] = entry | {"data_offsets": [at, at + high - low]}
        at += high - low
    return _joined(kept, b"".join(parts))


# Tables: CSV and Parquet.


def _cell(data: bytes, rng: random.Random) -> bytes:
    rows = [line.split(",") for line in data.decode().splitlines()]
    row, column = rng.randrange(len(rows)), rng.randrange(len(rows[0]))
    odd = ("", "nan", "inf", "-inf", "1e400", "x", "1,2", '"', "2001-01-01", "1e", "0x1F", "True", "9" * 400, "y" * LONG, "\0", "1_000", "٣")
    rows[row][column] = rng.choice(odd)
    return "\n".join(map(",".join, rows)).encode()


def _column(data: bytes, rng: random.Random) -> bytes:
    rows = [line.split(",") for line in data.decode().splitlines()]
    at, other, how = rng.randrange(len(rows[0])), rng.randrange(len(rows[0])), rng.randrange(4)
    for row in rows:
        if how == 0:
            del row[at]
        elif how == 1:
            row.append(row[at])
        elif how == 2:
            row[at], row[other] = row[other], row[at]
        elif row is rows[0]:
            row[at] = rng.choice(("", "unknown", "u_nowhere", "q_", "time", "../x", "qx", "enabled_elbow"))
    return "\n".join(map(",".join, rows)).encode()


def _table(data: bytes, rng: random.Random) -> bytes:
    """A column of another kind, of hostile numbers, twice, missing or renamed; rows out of order, or none."""
    table = pd.read_parquet(io.BytesIO(data))
    name = rng.choice(list(table.columns))
    odd: tuple[Any, ...] = (None, np.nan, np.inf, -np.inf, 1e308, -1.0, 0.0, 10**18)
    kinds = ("text", [1, 2], {"a": 1}, b"\0", True, pd.Timestamp("2001-01-01"), pd.Timedelta("1s"), 1 + 2**40)
    how = rng.randrange(7)
    if how == 0:
        table[name] = table[name].astype(object)
        table.at[rng.randrange(len(table)), name] = rng.choice(odd)
        table[name] = pd.to_numeric(table[name], errors="coerce")
    elif how == 1:
        value = rng.choice(kinds + odd)
        table[name] = [value] * len(table)
    elif how == 2:
        table = table.drop(columns=name)
    elif how == 3:
        table = table.rename(columns={name: rng.choice(("unknown", "", "u_nowhere", "time", "../x"))})
        if table.columns.duplicated().any():
            raise ValueError("Parquet takes each name once")
    elif how == 4:
        table = table.sample(frac=rng.choice((0.0, 0.5, 1.0)), random_state=rng.randrange(100))
    elif how == 5:
        table = table.iloc[: rng.choice((0, 1, 2))]
    else:
        table[name] = table[name].astype(rng.choice(("str", "category", "int8", "float32")))
    file = io.BytesIO()
    table.to_parquet(file)
    return file.getvalue()


def _twin_columns(data: bytes, rng: random.Random) -> bytes:
    table = pq.read_table(io.BytesIO(data))
    at = rng.randrange(table.num_columns)
    file = io.BytesIO()
    pq.write_table(table.append_column(table.column_names[at], table.column(at)), file)
    return file.getvalue()


def _pandas_words(data: bytes, rng: random.Random) -> bytes:
    """What pandas keeps about itself in a Parquet file, spoilt."""
    table = pq.read_table(io.BytesIO(data))
    words = table.schema.metadata[b"pandas"]
    spoiled = rng.choice((_cut, _flipped, _as_json(_replaced), _as_json(_deleted)))(words, rng)
    file = io.BytesIO()
    pq.write_table(table.replace_schema_metadata({b"pandas": spoiled}), file)
    return file.getvalue()


def _swollen_table(data: bytes, rng: random.Random) -> bytes:
    """A few kilobytes that are a table of so many rows."""
    names = pq.read_table(io.BytesIO(data)).column_names
    value = pa.DictionaryArray.from_arrays(pa.array(np.zeros(BOMB, np.int32)), pa.array([0.0]))
    file = io.BytesIO()
    pq.write_table(pa.table(dict.fromkeys(names, value)), file, compression="zstd")
    return file.getvalue()


# HDF5: data sets in groups.


def _sets(data: bytes, rng: random.Random, change: Callable[[Any, Any], None]) -> bytes:
    """The file with one of its data sets made anew by `change` (its group, and the set)."""
    import h5py

    file = io.BytesIO(data)
    with h5py.File(file, "r+") as found:
        places: list[str] = []
        found.visititems(lambda name, one: places.append(name) if isinstance(one, h5py.Dataset) else None)
        one = found[rng.choice(places)]
        change(one.parent, one)
    return file.getvalue()


def _swollen_set(data: bytes, rng: random.Random) -> bytes:
    """A data set of so many rows, none of which is in the file."""

    def swell(group: Any, one: Any) -> None:
        name, shape, kind = one.name, (BOMB, *one.shape[1:]), one.dtype
        del group[name]
        group.create_dataset(name, shape, kind, chunks=(1 << 20, *(1,) * (len(shape) - 1)), compression="gzip")

    return _sets(data, rng, swell)


def _set_of_another_kind(data: bytes, rng: random.Random) -> bytes:
    """Texts, complex numbers, other shapes, or a group, where there were numbers."""

    def exchange(group: Any, one: Any) -> None:
        name, values = one.name, one[()]
        del group[name]
        how = rng.randrange(5)
        if how == 0:
            group.create_dataset(name, data=[b"x"] * len(values))
        elif how == 1:
            group.create_dataset(name, data=values.astype(complex))
        elif how == 2:
            group.create_dataset(name, data=rng.choice((values[:0], values[None], values.ravel()[:1], np.float64(1.0))))
        elif how == 3:
            group.create_dataset(name, data=np.full(values.shape, rng.choice((np.nan, np.inf, 1e308))))
        else:
            group.create_group(name)

    return _sets(data, rng, exchange)


# NPZ: arrays in a zip archive.


def _arrays(data: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(data)) as found:
        return dict(found)


def _packed(arrays: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _array(data: bytes, rng: random.Random) -> bytes:
    arrays = _arrays(data)
    name = rng.choice(list(arrays))
    one = arrays[name]
    odd: tuple[Any, ...] = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e30, 0.0)
    how = rng.randrange(6)
    if how == 0:
        one.flat[rng.randrange(one.size)] = rng.choice(odd)
    elif how == 1:
        one[:] = rng.choice(odd)
    elif how == 2:
        arrays[name] = rng.choice((one.T, one[:, :-1], one[:-1], one[:0], one.ravel(), one[None], np.array(1.0), one[:1]))
    elif how == 3:
        kinds: tuple[Any, ...] = (str, bytes, complex, "datetime64[s]", bool, [("a", float)], object)
        arrays[name] = one.astype(rng.choice(kinds))
    elif how == 4:
        arrays[rng.choice(("unknown", "../../x", f"{MODULE}:PAIR"))] = arrays.pop(name)
    else:
        arrays[name] = np.array([Payload(), *one.ravel()], object)
    return _packed(arrays)


def _npy_header(data: bytes, rng: random.Random) -> bytes:
    """An array whose header says something absurd."""
    file, out = zipfile.ZipFile(io.BytesIO(data)), io.BytesIO()
    spoiled = rng.choice(file.namelist())
    shape = rng.choice(("(99999999999, 8)", "(-1, 4)", "()", "(4,)", "(9223372036854775807, 9223372036854775807)", "(1e3,)", "('a',)", "__import__('os')"))
    with zipfile.ZipFile(out, "w") as archive:
        for name in file.namelist():
            text = file.read(name)
            if name == spoiled:
                header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
                header += b" " * (63 - (10 + len(header)) % 64) + b"\n"
                text = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + text[128:]
            archive.writestr(name, text)
    return out.getvalue()


def _swollen_arrays(data: bytes, rng: random.Random) -> bytes:
    """A few hundred kilobytes that are arrays of so many rows."""
    return _packed({name: np.broadcast_to(np.zeros(1), (BOMB // 8, one.shape[1])) for name, one in _arrays(data).items()})


# Robot models.


def _element(data: bytes, rng: random.Random) -> bytes:
    root = ET.fromstring(data)
    parents = [(parent, child) for parent in root.iter() for child in parent]
    parent, child = rng.choice(parents)
    how = rng.randrange(6)
    if how == 0:
        parent.remove(child)
    elif how == 1:
        parent.append(copy.deepcopy(child))
    elif how == 2:
        other = rng.choice(parents)[0]
        other.append(copy.deepcopy(child))
    elif how == 3:
        child.tag = rng.choice(("unknown", "link", "joint", "robot", "mujoco", "inertial", "mesh"))
    else:
        element = rng.choice([one for one in root.iter() if one.attrib])
        name = rng.choice(list(element.attrib))
        if how == 4:
            del element.attrib[name]
        else:
            numbers = ("0", "-1", "nan", "inf", "1e400", "1e30", "1e-30", "1 2", "0 0 0", "1e30 0 0", "nan 0 0")
            texts = ("", "base", "free", "ball", "floating", "x" * LONG, "../../etc/passwd", "two words", "a:rotor", "\n", "%n%s")
            element.set(name, rng.choice(numbers + texts))
    return ET.tostring(root)


def _entities(data: bytes, rng: random.Random) -> bytes:
    """Entities: from elsewhere, of themselves, or a thousand million of them."""
    laughs = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 10))
    elsewhere = ('<!ENTITY e SYSTEM "file:///etc/passwd">', '<!ENTITY e SYSTEM "http://127.0.0.1:9/x">')
    kinds = (*elsewhere, '<!ENTITY e "&e;">', f'<!ENTITY l0 "lol">{laughs}<!ENTITY e "&l9;">')
    text = re.sub(r"<\?xml[^>]*\?>", "", data.decode())
    root = ET.fromstring(data).tag
    at = rng.choice([found.start() for found in re.finditer(r"</\w+>", text)] + [found.start(1) for found in re.finditer(r'name="([^"]*)"', text)])
    return f"<!DOCTYPE {root} [{rng.choice(kinds)}]>{text[:at]}&e;{text[at:]}".encode()


def _shape(data: bytes, rng: random.Random) -> bytes:
    """A shape that is a file elsewhere, or of a size that no shape has."""
    files = ("/etc/passwd", "../../../../etc/passwd", "package://nowhere/x.stl", "/dev/zero.obj", "robot.urdf", "")
    sizes = ('sphere radius="1e30"', 'sphere radius="-1"', 'box size="nan 1 1"', "box", 'capsule radius="0" length="0"', "cone", "mesh")
    shapes = [*(f'<mesh filename="{name}"/>' for name in files), *(f"<{size}/>" for size in sizes)]
    root = ET.fromstring(data)
    geometry = ET.fromstring(f"<collision><geometry>{rng.choice(shapes)}</geometry></collision>")
    rng.choice(root.findall("link")).append(geometry)
    return ET.tostring(root)


def _deep(data: bytes, rng: random.Random) -> bytes:
    text = data.decode()
    at = text.rindex("</")
    return (text[:at] + "<a>" * DEEP + "</a>" * DEEP + text[at:]).encode()


_BYTES = (
    *(("cut off", _cut), ("cut off", _cut), ("bits flipped", _flipped), ("bits flipped", _flipped), ("zeros", _zeroed), ("bytes lost", _lost)),
    *(("bytes twice", _twice), ("random bytes", _noise), ("another file", _other)),
)
_TEXT = (("lines", _lines), ("lines", _lines), ("coding", _coded), ("word replaced", _word), ("word replaced", _word))
_JSON = (*((name, _as_json(change)) for name, change in _TREES), ("odd text", _text_put(_JSON_TEXTS, _as_json)))
_YAML = (*((name, _as_yaml(change)) for name, change in _TREES), ("odd text", _text_put(_YAML_TEXTS, _as_yaml)), ("aliases of aliases", _laughing))
_HEADER = tuple((f"header: {name}", _in_header(change)) for name, change in _TREES if name != "schema")
_PLACES = (("header's size", _header_size), ("shape", _reshaped), ("absurd shape", _absurd_shape), ("numbers", _numbers_put), ("tensor left out", _one_less))
#: By form of file, what is done to one and what that is called.
FORMS: dict[str, tuple[tuple[str, Callable[[bytes, random.Random], bytes]], ...]] = {
    "bytes": _BYTES,
    "hdf5": (*_BYTES, *_BYTES, ("swollen", _swollen_set), ("kind", _set_of_another_kind)),
    "json": (*_BYTES, *_TEXT, *_JSON, *_JSON, *_JSON),
    "yaml": (*_BYTES, *_TEXT, *_YAML, *_YAML, *_YAML),
    "safetensors": (*_BYTES, *_HEADER, *_PLACES, *_PLACES),
    "csv": (*_BYTES, *_TEXT, ("cell", _cell), ("cell", _cell), ("column", _column), ("column", _column)),
    "parquet": (*_BYTES, *([("table", _table)] * 10), ("columns alike", _twin_columns), ("pandas' words", _pandas_words), ("swollen", _swollen_table)),
    "npz": (*_BYTES, *([("array", _array)] * 8), ("array's header", _npy_header), ("array's header", _npy_header), ("swollen", _swollen_arrays)),
    "urdf": (*_BYTES, *_TEXT, *([("element", _element)] * 8), ("entities", _entities), ("shape", _shape), ("shape", _shape), ("deep", _deep)),
    "mjcf": (*_BYTES, *_TEXT, *([("element", _element)] * 8), ("entities", _entities), ("deep", _deep)),
}
