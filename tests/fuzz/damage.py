"""Damaged input: valid samples with pieces flipped, cut, doubled, glued, or replaced by what readers stumble over."""

import copy
import io
import json
import random

import numpy as np

#: What to put where something else was: numbers too large, not numbers, characters that break lines or turn them around.
ODD = [
    *("0", "-1", "1e400", "NaN", "Infinity", "9" * 400, "9" * 5000, "18446744073709551616", "0x10", "1_0", "\uff11", "4.5"),
    *("", " ", ",", '"', "'", "\\", "\r\n", "\n", "\t", "\0", "\u2028", "\u202e", "\u202f", "\ufeff", "\x1b[31m", "null", "true"),
    *("[" * 2000, '{"a":' * 500, "x" * 140_000, "{}", "[]", "%s", "../", "=", "--json", "\U0001f600"),
]
NODES = [None, True, False, 0, -1, 2**31, 2**63, 10**30, 1.5, 1e400, "", "x", "a\nb", "\ud800", "x" * 200, [], {}, [[]], [0] * 50]


def damaged(rng: random.Random, samples: list[bytes]) -> bytes:
    """One of the samples after one to four accidents."""
    data = bytearray(rng.choice(samples))
    for _ in range(rng.randint(1, 4)):
        at, length = rng.randrange(len(data) + 1), rng.choice((1, 1, 2, 8, 64))
        match rng.randrange(7):
            case 0 if at < len(data):
                data[at] ^= 1 << rng.randrange(8)
            case 1:
                del data[at : at + length]
            case 2:
                data[at:at] = data[at : at + length] * rng.choice((1, 2, 50))
            case 3:
                data[at:] = rng.choice(samples)[rng.randrange(len(data) + 1) :]
            case 4:
                data[at : at + length] = rng.choice(ODD).encode()
            case 5:
                data[at:at] = rng.choice(ODD).encode()
            case 6:
                del data[at:]
    return bytes(data)


def damaged_json(rng: random.Random, samples: list[bytes]) -> bytes:
    """Valid JSON with one to three values or keys replaced, doubled or left out; now and then broken text."""
    if rng.random() < 0.4:
        return damaged(rng, samples)
    data = json.loads(rng.choice(samples))
    for _ in range(rng.randint(1, 3)):
        places = _places(data)
        if not places:
            break
        node, key = rng.choice(places)
        match rng.randrange(5):
            case 0 | 1:
                node[key] = copy.deepcopy(rng.choice(NODES))
            case 2:
                other, there = rng.choice(places)
                node[key] = copy.deepcopy(other[there])
            case 3:
                del node[key]
            case 4 if isinstance(node, list):
                node[key:key] = copy.deepcopy(node[key : key + 1]) * rng.choice((1, 3, 30))
            case 4:
                node[rng.choice(("name", "tasks", "extra", "", "a\nb"))] = node[key]
    return json.dumps(data).encode()


def _places(data) -> list[tuple[dict | list, str | int]]:
    """Every container in it and every key there, from outside to inside and in order."""
    places, open_ = [], [data] if isinstance(data, dict | list) else []
    while open_:
        node = open_.pop()
        at = list(node) if isinstance(node, dict) else range(len(node))
        places += [(node, key) for key in at]
        open_ += [node[key] for key in reversed(at) if isinstance(node[key], dict | list)]
    return places


def damaged_npz(rng: random.Random, samples: list[bytes]) -> bytes:
    """An archive of arrays of which some have another type, shape, length or name; now and then broken bytes."""
    if rng.random() < 0.4:
        return damaged(rng, samples)
    with np.load(io.BytesIO(rng.choice(samples)), allow_pickle=False) as file:
        arrays = dict(file)
    for _ in range(rng.randint(1, 2)):
        if not arrays:
            break
        name = rng.choice(sorted(arrays))
        array = arrays[name]
        match rng.randrange(8):
            case 0 if array.dtype.kind in "iu":
                arrays[name] = array.astype(
                    rng.choice(("float64", "int8", "uint64", "U4", "O", "complex64", "M8[s]", "bool", "V3"))
                )
            case 1 if array.size:
                arrays[name] = array.reshape(rng.choice(((1, -1), (-1, 1), (-1,))))
            case 2 if array.ndim:
                arrays[name] = array[: rng.randrange(3)]
            case 3:
                del arrays[name]
            case 4:
                arrays[rng.choice(("op", "other", "x" * 300, "a\nb", "../a"))] = array
            case 5 if array.size and array.dtype.kind in "iu":
                arrays[name] = array.copy()
                arrays[name].flat[rng.randrange(array.size)] = rng.choice(
                    (0, 255, np.iinfo(array.dtype).max, np.iinfo(array.dtype).min)
                )
            case 6:
                arrays[name] = np.asarray(rng.choice((0, "text", np.nan, b"")))
            case 7 if array.ndim:
                arrays[name] = np.concatenate([array, array])
    file = io.BytesIO()
    rng.choice((np.savez, np.savez_compressed))(file, **{k: v for k, v in arrays.items() if k != "file"})
    return file.getvalue()


def damaged_arguments(rng: random.Random, samples: list[list[str]]) -> list[str]:
    """A command line with one to three arguments changed, left out, doubled or taken from another."""
    made = list(rng.choice(samples))
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(1, len(made)) if len(made) > 1 else 0
        match rng.randrange(5):
            case 0:
                made[at] = rng.choice([odd for odd in ODD if "\0" not in odd])
            case 1 if len(made) > 1:
                del made[at]
            case 2:
                made.insert(at + 1, made[at])
            case 3:
                made.insert(at + 1, rng.choice(rng.choice(samples)))
            case 4:
                key, equals, _ = made[at].partition("=")
                made[at] = key + equals + rng.choice(("0", "-1", "3", "10000000000", "nan", "true", "x", "", "9" * 5000))
    return made
