"""The precision of networks' layers in training: bfloat16 on devices that multiply it in hardware, float32 elsewhere.

A processor without bfloat16 units emulates them a hundred times slower than it multiplies float32.
"""

from __future__ import annotations

import torch


def layer_precision(device: torch.device) -> torch.dtype:
    """Return bfloat16 if the device has units for it, else float32."""
    if device.type == "cuda":
        return torch.bfloat16 if torch.cuda.is_bf16_supported(including_emulation=False) else torch.float32
    if device.type == "cpu":
        has_units = torch.backends.mkldnn.is_available() and torch.ops.mkldnn._is_mkldnn_bf16_supported()
        return torch.bfloat16 if has_units else torch.float32
    return torch.float32


def layer_autocast(device: torch.device, precision: torch.dtype | None = None) -> torch.autocast:  # noqa: TID251
    """Return the context in which layers run in a precision, by default `layer_precision`.

    Keep geometry outside: it needs the digits.
    """
    return torch.autocast(device.type, torch.bfloat16, enabled=(precision or layer_precision(device)) == torch.bfloat16)  # noqa: TID251
