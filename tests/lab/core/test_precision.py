"""Precision of layers in training: bfloat16 only on devices with units for it."""

from __future__ import annotations

import pytest
import torch

from bodysense_lab.core.fit import describe_machine, launch_fabric
from bodysense_lab.core.precision import layer_autocast, layer_precision


@pytest.mark.parametrize(("has_units", "precision"), [(True, torch.bfloat16), (False, torch.float32)])
def test_layers_run_in_bfloat16_only_on_processors_with_units_for_it(
    has_units: bool, precision: torch.dtype, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: has_units)
    cpu = torch.device("cpu")
    assert layer_precision(cpu) == precision
    with layer_autocast(cpu):
        assert torch.nn.Linear(3, 2)(torch.ones(1, 3)).dtype == precision
    assert describe_machine(launch_fabric(), True).endswith(
        f", {str(precision).removeprefix('torch.')} layers, 1 process"
    )
    assert describe_machine(launch_fabric(), False).endswith(", float32 layers, 1 process")


@pytest.mark.parametrize(("has_units", "precision"), [(True, torch.bfloat16), (False, torch.float32)])
def test_emulated_bfloat16_of_an_accelerator_does_not_count(
    has_units: bool, precision: torch.dtype, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation=True: has_units)
    assert layer_precision(torch.device("cuda")) == precision
    assert layer_precision(torch.device("mps")) == torch.float32
