"""Python values to what JSON can hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import msgspec
import numpy as np

from rakelight.errors import fsencode_safe


def json_bytes(value: Any) -> bytes:
    """Indented UTF-8 JSON; what is not finite becomes null."""
    return msgspec.json.format(msgspec.json.encode(plain(value)), indent=2) + b"\n"


def plain(value: Any) -> Any:
    r"""`value` as dict, list, str, bool, int, finite float or None.

    Numbers that are not finite become None (NaN is not JSON), bytes of a file name that are not
    UTF-8 become \\xNN, and what JSON does not know its text.

    >>> plain({"steps": np.int64(3), "gain": float("nan"), "size": (1, 2)})
    {'steps': 3, 'gain': None, 'size': [1, 2]}
    """
    match value:
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case None | bool() | int():
            return value
        case float():
            return value if math.isfinite(value) else None
        case Enum():
            return plain(value.value)
        case str():
            return fsencode_safe(value)
        case msgspec.Struct():
            return {key: plain(getattr(value, key)) for key in value.__struct_fields__}
        case Mapping():
            return {fsencode_safe(str(key)): plain(item) for key, item in value.items()}
        case _ if is_dataclass(value) and not isinstance(value, type):
            return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
        case Iterable():
            return [plain(item) for item in value]
        case _:
            return fsencode_safe(str(value))
