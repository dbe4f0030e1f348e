"""Reading of safetensors files: tensors by name, and metadata.

A file is eight bytes of length, a JSON header and the numbers.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping

import numpy as np

from bodysense.errors import BodysenseError

TYPES: Mapping[str, type[np.generic]] = {"I8": np.int8, "F16": np.float16, "F32": np.float32, "F64": np.float64}
_MOST_HEADER = 100_000_000  # bytes; safetensors' own limit


def tensors_of(data: bytes, name: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the tensors and the metadata of a file's bytes; `name` is the name of the file in messages.

    Raises BodysenseError for a damaged file and for tensors of other types than `TYPES`.
    """
    try:
        (size,) = struct.unpack_from("<Q", data)
        if size > min(len(data) - 8, _MOST_HEADER):
            raise ValueError("it ends within its header")
        header = json.loads(data[8 : 8 + size])
        metadata = header.pop("__metadata__", {})
        if not all(isinstance(text, str) for text in metadata.values()):
            raise ValueError("its metadata is not text")
        tensors = {}
        for key, entry in header.items():
            first, last = entry["data_offsets"]
            values = np.frombuffer(data[8 + size + first : 8 + size + last], TYPES[entry["dtype"]])
            tensors[key] = values.reshape(entry["shape"])
    except (struct.error, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BodysenseError(f"{name}: not a readable safetensors file ({error}); write or copy it again") from None
    return tensors, metadata
