"""Opening a network file: an .onnx that says of itself what it is, run by ONNX Runtime on one thread."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from bodysense.errors import BodysenseError


def open_network(
    path: str | Path, *, format: str, kind: str, fields: Sequence[str], command: str, batch: int | None = None
) -> tuple[Any, dict[str, Any]]:
    """The file's session (onnxruntime.InferenceSession) and its card.

    Args:
        path: the .onnx file.
        format: what its card must name as `format`.
        kind: what such a network is called.
        fields: what else the card must have.
        command: what writes such files.
        batch: for how many at a time the session is, where the file leaves that open.

    Raises BodysenseError for a file that is not there, is no ONNX, or is not ours.
    """
    import onnxruntime

    path = Path(path)
    if not path.is_file():
        raise BodysenseError(f"{path}: no such model file; give the .onnx that `{command}` wrote")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    if batch is not None:
        options.add_free_dimension_override_by_name("batch", batch)
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime raises classes of its own for every way a file can be wrong
        raise BodysenseError(f"{path}: not a readable ONNX model ({str(error).splitlines()[0][:120]})") from None
    card = session.get_modelmeta().custom_metadata_map
    if card.get("format") != format:
        raise BodysenseError(
            f"{path}: not a bodysense {kind} (format {card.get('format', 'not given')!r}, wanted {format!r}); "
            f"give the .onnx that `{command}` wrote"
        )
    missing = [name for name in fields if name not in card]
    if missing:
        raise BodysenseError(f"{path}: its card has no {missing[0]!r}; export the network again")
    return session, {name: _read(value) for name, value in card.items() if name != "format"}


def open_packaged(name: str, **wanted: Any) -> tuple[Any, dict[str, Any]]:
    """`open_network` of a file in `bodysense/weights`."""
    with as_file(files("bodysense.weights").joinpath(name)) as path:
        return open_network(path, **wanted)


def _read(text: str) -> Any:
    """A field of a card: JSON where we wrote it, plain text where another tool did."""
    try:
        return json.loads(text)
    except ValueError:
        return text
